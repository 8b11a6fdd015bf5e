// Why: what is claimed, with the values of its parts after the turn that is looked at; and of a run
// without end why nothing forbids it.

class Why {
  constructor(view) {
    this.view = view;
    this.shown = "";
    this.inside = made("div", { class: "inside" });
    const { loop, tracks, ending } = view.telling.story;
    this.isUsed = Boolean(tracks.length || loop);
    const heading = tracks.length ? "What is claimed" : loop ? "Why nothing forbids it" : ending.headline;
    this.element = made("section", { class: "panel", "aria-label": heading }, made("h2", {}, heading), this.inside);
  }

  mark() {
    const { telling, position } = this.view, { story } = telling;
    const found = story.tracks.map((track) => [track, telling.formulaAt(track, position)]);
    const key = found.map(([, one]) => one?.moment ?? -1).join();
    if (key === this.shown) return;
    this.shown = key;
    const parts = [];
    for (const [track, one] of found) {
      if (story.tracks.length > 1) parts.push(made("h3", {}, track.name));
      if (!one) {
        parts.push(made("p", { class: "quiet" }, "Nobody asks here."), made("code", {}, track.text));
        continue;
      }
      parts.push(made("p", { class: "statement quiet" }, `after round ${telling.moments[one.moment].round}, ${telling.words(one.moment)}:`));
      parts.push(made("ul", { class: "tree" }, node(one.formula, 0)));
    }
    if (story.loop) parts.push(...this.loop(story.loop));
    this.inside.replaceChildren(...parts);
  }

  loop(loop) {
    const which = loop.first === loop.last ? `Round ${loop.first} repeats` : `Rounds ${loop.first} to ${loop.last} repeat`;
    const parts = [made("h3", {}, `${which} for ever, and that is fair`), made("ul", { class: "fair" }, ...loop.fair.map((line) => made("li", {}, line)))];
    if (loop.left_behind.length) {
      parts.push(made("p", { class: "quiet" }, `Only ${loop.left_behind.join(", ")} differ each time; nothing hangs on them.`));
    }
    if (loop.excluded_by.length) {
      parts.push(made("h3", {}, loop.excluded_by.length > 1 ? "If it may be expected, one of these excludes it" : "If it may be expected, this excludes it"));
      parts.push(...loop.excluded_by.map((line) => made("pre", { class: "excluded" }, line)));
    }
    return parts;
  }
}

/** A part of a formula with its value; open along what decides. */
function node(part, depth) {
  const isTrue = part.value === "true", isFalse = part.value === "false";
  const sign = isTrue ? "✓ " : isFalse ? "✗ " : "";
  const value = part.value === null
    ? made("span", { class: "value none" }, part.note || "unknown")
    : made("span", { class: `value ${isTrue ? "true" : isFalse ? "false" : ""}` }, sign + part.value);
  const head = [...(part.binding ? [made("span", { class: "binding" }, part.binding)] : []), made("code", {}, part.text), value];
  const item = made("li", { class: part.decides ? null : "spare" });
  if (!part.parts.length && !part.left_out) {
    item.append(made("div", { class: "leaf" }, ...head));
    return item;
  }
  const rest = part.left_out ? [made("li", { class: "rest" }, part.parts.length ? `… and ${part.left_out} more like these` : "…")] : [];
  const inside = made("ul", {}, ...grouped(part.parts, depth), ...rest);
  item.append(made("details", part.decides && depth < 8 ? { open: "" } : {}, made("summary", {}, ...head), inside));
  return item;
}

/** Parts; instances of a quantifier that do not decide it stand together, where they are many. */
function grouped(parts, depth) {
  const spare = parts.filter((part) => part.binding && !part.decides);
  if (spare.length < 3) return parts.map((part) => node(part, depth + 1));
  const words = `${spare.length} instances that are ${spare[0].value}`;
  const together = made("li", { class: "spare" }, made("details", {}, made("summary", {}, made("span", { class: "quiet" }, words)), made("ul", {}, ...spare.map((part) => node(part, depth + 1)))));
  return [...parts.filter((part) => !spare.includes(part)).map((part) => node(part, depth + 1)), together];
}
