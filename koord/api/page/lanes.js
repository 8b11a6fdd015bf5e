// Swim lanes: robots and variables down, rounds across.

const WINDOW = 80; // so many rounds are drawn at a time
const MOST_ROBOTS = 60;
const MOST_ROWS = 60;

class Lanes {
  constructor(view) {
    this.view = view; // {telling, position, go(position)}
    this.all = false; // whether rows that never change are shown
    this.own = null; // whether robots' own variables are shown; null: not yet decided
    this.first = 0; // of the rounds that are drawn
    const { story } = view.telling;
    const shared = story.rows.some((row) => row.robot === null || row.is_read);
    this.own = !shared || story.robots.length <= 3;
    this.scroll = made("div", { class: "scroll", tabindex: "-1" });
    this.element = made("section", { class: "panel lanes", "aria-label": "Rounds" });
    this.draw();
  }

  rowsShown() {
    const { telling } = this.view, { story } = telling;
    return story.rows
      .map((row, k) => ({ ...row, k }))
      .filter((row) => row.robot === null || row.is_read || this.own)
      .filter((row) => this.all || telling.moving.has(row.k) || (row.is_read && row.home !== "status"))
      .slice(0, MOST_ROWS);
  }

  draw() {
    const { telling } = this.view, { story } = telling;
    const rounds = telling.rounds, at = telling.roundOf.get(telling.moments[this.view.position].round);
    if (at < this.first || at >= this.first + WINDOW) {
      this.first = Math.max(0, Math.min(at - Math.floor(WINDOW / 4), rounds.length - WINDOW));
    }
    const drawn = rounds.slice(this.first, this.first + WINDOW);
    const rows = this.rowsShown();
    const hidden = story.rows.filter((row) => row.home !== "status").length - rows.length;
    const toggles = [
      this.toggle("robots' own variables", this.own, () => { this.own = !this.own; }),
      this.toggle("values that never change", this.all, () => { this.all = !this.all; }),
    ];
    const head = made("h2", {}, "Rounds", made("small", { class: "quiet" }, this.range(drawn)), made("span", { class: "spacer" }),
      ...(hidden > 0 || this.all || this.own ? toggles : []));
    this.body = made("tbody", {});
    const table = made("table", { class: "grid" },
      made("caption", { hidden: "" }, "What each robot does in each round, and the values of variables after it"),
      made("thead", {}, this.heading(drawn)), this.body);
    this.fill(drawn, rows);
    const kept = [this.scroll.scrollLeft, this.scroll.scrollTop];
    this.scroll.replaceChildren(table);
    this.element.replaceChildren(head, this.scroll);
    [this.scroll.scrollLeft, this.scroll.scrollTop] = kept;
    this.reveal();
  }

  toggle(words, on, change) {
    return made("button", { class: "toggle", "aria-pressed": String(on), onclick: () => { change(); this.draw(); } }, words);
  }

  range(drawn) {
    const { telling } = this.view, { story } = telling, total = telling.rounds[telling.rounds.length - 1].number;
    const before = story.left_out ? `, ${plural(story.left_out, "round")} before are left out` : "";
    if (drawn.length === telling.rounds.length) return `${plural(total, "round")} of ${story.delta_s} s${before}`;
    return `${drawn[0].number} to ${drawn[drawn.length - 1].number} of ${total}${before}`;
  }

  heading(drawn) {
    const { telling, go } = this.view, { loop } = telling.story;
    const cells = drawn.map((round) => {
      const isLooped = loop && round.number >= loop.first && round.number <= loop.last;
      const isStep = telling.story.ending.kind === "step";
      const name = round.number === 0 ? (isStep ? "before" : "start") : String(round.number);
      const words = round.number === 0 ? "The start" : `Round ${round.number}${isLooped ? ", which repeats for ever" : ""}`;
      return made("th", { scope: "col", class: isLooped ? "loop" : null, "data-round": round.number },
        made("button", { tabindex: "-1", title: words, "aria-label": words, onclick: () => go(telling.endOf(round)) },
          isLooped ? `↻ ${name}` : name));
    });
    if (loop && drawn.some((round) => round.number === loop.last)) {
      const back = telling.rounds[telling.roundOf.get(loop.first)];
      cells.push(made("th", { scope: "col", class: "loop" },
        made("button", { class: "again", tabindex: "-1", onclick: () => go(back.turns[0]) },
          loop.first === loop.last ? "↻ again" : `↻ again from ${loop.first}`)));
    }
    return made("tr", {}, made("th", { scope: "col" }, "round"), ...cells);
  }

  fill(drawn, rows) {
    const { telling } = this.view, { story } = telling;
    story.robots.slice(0, MOST_ROBOTS).forEach((_, robot) => this.body.append(this.lane(drawn, robot)));
    if (story.robots.length > MOST_ROBOTS) {
      this.body.append(made("tr", {}, made("th", { scope: "rowgroup" }, `and ${story.robots.length - MOST_ROBOTS} more robots`)));
    }
    if (telling.moments.some((moment) => moment.rule === "ENV-TRANS" && (moment.changes.length || moment.broken.length))) {
      this.body.append(this.lane(drawn, null));
    }
    for (const track of story.tracks) this.body.append(this.track(drawn, track));
    let group = "";
    const ends = drawn.map((round) => telling.valuesAfter(telling.endOf(round)));
    for (const row of rows) {
      const of = row.robot === null ? "shared" : `of robot ${row.robot}`;
      if (of !== group) this.body.append(made("tr", {}, made("th", { scope: "rowgroup" }, of)));
      group = of;
      this.body.append(this.row(drawn, ends, row));
    }
  }

  lane(drawn, robot) {
    const { telling, go } = this.view, { story } = telling;
    const name = robot === null ? (story.ending.kind === "step" ? "together" : "environment") : `robot ${robot}`;
    const kind = robot === null ? "" : telling.robot(robot).kind.name;
    const cells = drawn.map((round) => {
      // Of a step no order of turns is known.
      const order = story.ending.kind === "step" ? [] : round.turns.filter((k) => telling.moments[k].robot !== null);
      const position = round.turns.find((k) => telling.moments[k].robot === robot && !["INIT", "RELOAD"].includes(telling.moments[k].rule));
      if (position === undefined) return made("td", { "data-round": round.number }, "");
      const deed = telling.deed(position), moment = telling.moments[position];
      if (robot === null && !moment.changes.length && !moment.broken.length) return made("td", { "data-round": round.number }, "");
      const place = order.length > 1 && robot !== null && deed.kind !== "skip" ? made("sup", { "aria-hidden": "true" }, String(order.indexOf(position) + 1)) : "";
      const isBroken = ["violated", "fault", "step"].includes(story.ending.kind) && story.ending.moment === position;
      const words = `Round ${round.number}: ${telling.words(position)}${place ? `, as number ${order.indexOf(position) + 1}` : ""}${isBroken ? ", which breaks the claim" : ""}`;
      const shown = robot === null ? (moment.broken.length ? "✗" : plural(moment.changes.length, "value")) : deed.short ?? deed.words;
      const button = made("button", {
        class: `turn ${deed.kind}${isBroken ? " breaks" : ""}`, "data-turn": position, tabindex: "-1", title: words, "aria-label": words, onclick: () => go(position),
      }, isBroken ? "✗ " : "", shown, place);
      if (deed.kind === "event") paintEvent(button, deed.event);
      return made("td", { "data-round": round.number }, button);
    });
    return made("tr", {}, made("th", { scope: "row" }, name, kind ? made("small", {}, kind) : ""), ...cells);
  }

  /** Whether a statement holds in a round: false if it fails after any turn of it. */
  track(drawn, track) {
    const cells = drawn.map((round) => {
      const found = round.turns.map((k) => track.truth[k]).filter((truth) => truth !== null);
      const holds = found.length ? !found.includes(false) : null;
      return made("td", { class: `cell ${holds}`, "data-round": round.number, title: holds === null ? "not asked" : holds ? "holds" : "does not hold" },
        holds === null ? "" : holds ? "✓" : "✗");
    });
    return made("tr", {}, made("th", { scope: "row", title: track.text }, track.name), ...cells);
  }

  row(drawn, ends, row) {
    const { telling } = this.view;
    const cells = drawn.map((round, k) => {
      const isChanged = round.turns.some((turn) => telling.moments[turn].changes.some((change) => change.row === row.k));
      const value = ends[k][row.k];
      return made("td", { class: `cell${isChanged ? " changed" : ""}`, "data-round": round.number, title: value },
        isChanged || k === 0 ? value : made("span", { class: "quiet" }, value));
    });
    return made("tr", {}, made("th", { scope: "row", class: "name", title: nameOf(row) }, row.name), ...cells);
  }

  /** Marks the turn that is looked at, without drawing anew. */
  mark() {
    const { telling, position } = this.view, round = telling.moments[position].round;
    const at = telling.roundOf.get(round);
    if (at < this.first || at >= this.first + WINDOW) {
      this.draw();
      return;
    }
    this.reveal();
  }

  reveal() {
    const { telling, position } = this.view, round = telling.moments[position].round;
    for (const old of this.element.querySelectorAll(".now, .current")) old.classList.remove("now", "current");
    for (const old of this.element.querySelectorAll('.turn[tabindex="0"]')) old.setAttribute("tabindex", "-1");
    for (const cell of this.element.querySelectorAll(`[data-round="${round}"]`)) cell.classList.add("now");
    for (const cell of this.element.querySelectorAll(".cell")) cell.classList.toggle("later", Number(cell.dataset.round) > round);
    const turn = this.element.querySelector(`[data-turn="${position}"]`);
    turn?.classList.add("current");
    turn?.setAttribute("tabindex", "0");
    const cell = this.element.querySelector(`thead [data-round="${round}"]`);
    if (!cell) return;
    const left = cell.offsetLeft - 150, right = cell.offsetLeft + cell.offsetWidth + 30 - this.scroll.clientWidth;
    if (this.scroll.scrollLeft > left) this.scroll.scrollLeft = left;
    else if (this.scroll.scrollLeft < right) this.scroll.scrollLeft = right;
  }
}

/** Events have colours by their position. */
function paintEvent(element, event) {
  element.style.setProperty("--colour", `var(--e${event % 6})`);
}
