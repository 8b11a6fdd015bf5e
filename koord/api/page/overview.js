// A whole verification: verdicts, what was found for them, and what they rest on.

const OUTCOMES = { holds: "✓", violated: "✗", unknown: "?" };

/** A verdict in words; the rest of it stands in `claim`. */
function verdictOf(claim, story) {
  if (claim.outcome === "violated") {
    if (!story) return "violated";
    if (story.loop) return `violated: ${story.loop.first === story.loop.last ? `round ${story.loop.first} repeats` : `rounds ${story.loop.first} to ${story.loop.last} repeat`} for ever`;
    const round = story.moments[story.ending.moment].round;
    return `violated ${round ? `in round ${round}` : "at the start"}${claim.fewest_rounds ? "" : ", perhaps sooner"}`;
  }
  if (claim.outcome === "unknown") return claim.through_round === null ? "unknown" : `unknown; holds through round ${claim.through_round}`;
  const everyone = claim.every_number_of_robots ? " for every N" : "";
  if (claim.kind === "liveness") return `holds${everyone}, ${claim.fairness.length ? "under fairness" : "in every run"}`;
  return claim.all_rounds ? `holds${everyone}${everyone ? "," : ""} in every round` : `holds through round ${claim.through_round}`;
}

function fairnessOf(names) {
  const kinds = ["robots", "locks"].filter((kind) => names.includes(kind)).map((kind) => `to ${kind}`);
  const expected = names.filter((name) => name !== "robots" && name !== "locks");
  return [...(kinds.length ? [`fairness ${kinds.join(" and ")}`] : []), ...(expected.length ? [`what is expected: ${expected.join(", ")}`] : [])].join("; ");
}

class Overview {
  constructor(shown) {
    this.shown = shown;
  }

  draw() {
    return this.shown.verifications.flatMap((one) => this.verification(one));
  }

  verification({ about, report, claims, texts }) {
    const count = claims.filter(({ claim }) => claim.outcome === report.outcome).length;
    const vacuously = report.vacuous && report.outcome === "holds" ? ", but vacuously" : "";
    const how = report.outcome === "holds" ? plural(claims.length, "claim") : `${count} of ${plural(claims.length, "claim")}`;
    const parts = [
      made("p", { class: "summary" }, made("span", { class: `outcome ${report.outcome}` }, `${OUTCOMES[report.outcome]} ${report.outcome}${vacuously}`),
        made("small", {}, `${how} · ${about} · ${report.seconds.toFixed(2)} s${report.interrupted ? " · interrupted" : ""}`)),
      made("section", { class: "panel", "aria-label": "Verdicts" }, this.claims(claims)),
    ];
    const section = (title, small, ...inside) => parts.push(made("section", { class: "panel", "aria-label": title },
      made("h2", {}, title, made("small", { class: "quiet" }, small)), made("div", { class: "inside" }, ...inside)));
    if (report.vacuities.length || report.not_looked_at.length) {
      section("Vacuity", "where verdicts say less than they seem to", made("ul", { class: "list" },
        ...report.vacuities.map((one) => made("li", {}, made("span", { class: "warn" }, one.certain ? "vacuous" : "warning"),
          ` ${[one.what, one.subject].filter(Boolean).join(" ")}: ${one.detail}${one.place ? ` (${one.place})` : ""}`)),
        ...report.not_looked_at.map((one) => made("li", {}, `not looked at to the end, whether it ever happens: ${one.what} ${one.subject}`))));
    }
    this.obstacles(claims, section);
    if (report.found_invariants.length) {
      section("Invariants that were found", "together they hold in every round", made("div", {}, ...report.found_invariants.map((text) => made("pre", { class: "excluded" }, text))));
    }
    if (report.rests_on) this.restsOn(report.rests_on, section);
    const left = Object.entries(report.left_out);
    if (left.length) section("What claims cannot depend on", "", made("ul", { class: "list" }, ...left.map(([name, what]) => made("li", {}, made("b", {}, name), `: ${what.join(", ")}`))));
    if (report.failures.length) section("What failed", "the verdicts stand", made("ul", { class: "list" }, ...report.failures.map((one) => made("li", {}, `${one.who}: ${one.what}`))));
    for (const text of texts) {
      const name = shortName(text.name);
      const lines = text.text.split("\n").map((line) => made("span", { class: `line${/^\s*#/.test(line) ? " comment" : ""}` }, line || "\u200b"));
      parts.push(made("section", { class: "panel", "aria-label": name }, made("h2", { class: "file" }, name),
        made("div", { class: "inside" }, made("div", { class: "text-pane", tabindex: "0" }, made("pre", { class: "code" }, ...lines)))));
    }
    return parts;
  }

  claims(claims) {
    const rows = claims.map(({ claim, text, stories }) => {
      const story = stories.length ? this.shown.stories[stories[0]] : null;
      const isStep = story?.ending.kind === "step";
      const looks = isStep ? [made("a", { class: "look", href: `#story=${stories[0]}` }, "look at a step that no proof gets over →")] : stories.map((k, at) => made("a", { class: "look", href: `#story=${k}` }, stories.length > 1 ? `look at run ${at + 1} →` : "look at the run →"));
      const more = [
        ...(claim.reason ? [claim.reason] : []),
        ...(claim.fairness.length ? [`it rests on ${fairnessOf(claim.fairness)}`] : []),
        ...(claim.ways ? [claim.ways.complete ? "there is no other way to break it within the bound" : claim.ways.reason ?? ""] : []),
      ].filter(Boolean);
      const engine = claim.engine === "none" ? "" : claim.engine;
      return made("tr", {},
        made("td", {}, made("span", { class: `outcome ${claim.outcome}`, "aria-hidden": "true" }, `${OUTCOMES[claim.outcome]} `), made("span", { class: "name" }, claim.name), text ? made("span", { class: "text" }, text) : ""),
        made("td", {}, made("span", { class: `outcome ${claim.outcome}` }, verdictOf(claim, story)), ...more.map((line) => made("span", { class: "more" }, line)), ...(looks.length ? [made("span", { class: "more" }, ...looks)] : [])),
        made("td", { class: "quiet" }, engine),
        made("td", { class: "time" }, claim.kept ? "kept" : `${claim.seconds.toFixed(2)} s`));
    });
    const head = made("tr", {}, ...["claim", "verdict", "engine", "time"].map((name) => made("th", { scope: "col", class: name === "time" ? "time" : null }, name)));
    return made("table", { class: "claims" }, made("thead", {}, head), made("tbody", {}, ...rows));
  }

  obstacles(claims, section) {
    const found = claims.filter(({ claim }) => claim.obstacles.length);
    if (!found.length) return;
    section("What stood in the way", "of an answer, or of a proof for all rounds", ...found.flatMap(({ claim }) => [
      made("h3", {}, claim.name),
      made("ul", { class: "list" }, ...claim.obstacles.map((one) => made("li", {}, `${one.engine === "none" ? "" : `${one.engine}: `}${one.what}; ${one.cure}`))),
    ]));
  }

  restsOn(found, section) {
    const named = (one) => `${one.kind} ${one.name}${one.promises > 1 ? `, promise ${one.promise} of ${one.promises}` : ""} (${one.place})`;
    const parts = [["needed", "needed"], ["spare", "not needed"], ["untried", "not tried in time"]]
      .filter(([key]) => found[key]?.length)
      .flatMap(([key, title]) => [made("h3", {}, title), made("ul", { class: "list" }, ...found[key].map((one) => made("li", {}, named(one))))]);
    section("What the proofs rest on", "assumptions, contracts, summaries", ...(parts.length ? parts : [made("p", {}, "nothing but the program")]));
  }
}
