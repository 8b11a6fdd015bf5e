// The turns of a round, in their order: who did what, and what changed.

class Turns {
  constructor(view) {
    this.view = view;
    this.element = made("section", { class: "panel", "aria-label": "Turns of the round" });
    this.round = -1;
  }

  mark() {
    const { telling, position, go } = this.view, moment = telling.moments[position];
    const round = telling.rounds[telling.roundOf.get(moment.round)];
    if (this.round !== moment.round) {
      this.round = moment.round;
      const { delta_s } = telling.story;
      const isStep = telling.story.ending.kind === "step";
      const heading = moment.round === 0 ? (isStep ? "Before" : "The start") : `Round ${moment.round}`;
      const times = moment.round === 0 ? "" : isStep ? "who runs what, and what changes together" : `t = ${short(delta_s * (moment.round - 1))} s to ${short(delta_s * moment.round)} s, turns in their order`;
      this.list = made("ol", { class: "turns" }, ...round.turns.map((k) => this.turn(k, go)));
      this.element.replaceChildren(made("h2", {}, heading, made("small", { class: "quiet" }, times)), made("div", { class: "inside" }, this.list));
    }
    round.turns.forEach((k, at) => {
      this.list.children[at].classList.toggle("current", k === position);
      this.list.children[at].classList.toggle("later", k > position);
      this.list.children[at].setAttribute("aria-current", k === position ? "step" : "false");
    });
  }

  turn(k, go) {
    const { telling } = this.view, { story } = telling, moment = telling.moments[k], deed = telling.deed(k);
    const before = telling.valuesBefore(k);
    const who = moment.robot === null ? deed.words : `robot ${moment.robot}`;
    const what = made("span", { class: "what" }, ...moment.changes.map(({ row, value }) =>
      made("span", { class: "change" }, `${nameOf(story.rows[row], moment.robot)} `, made("i", {}, `${before[row]} → `), made("b", {}, value))));
    for (const line of moment.output) what.append(made("span", { class: "output" }, line));
    for (const line of moment.broken) what.append(made("span", { class: "broke" }, `✗ ${line} is broken`));
    if (moment.fault) what.append(made("span", { class: "broke" }, `✗ fault: ${moment.fault.kind}${moment.fault.detail ? ` (${moment.fault.detail})` : ""}`));
    if (["violated", "fault"].includes(story.ending.kind) && story.ending.moment === k && !moment.fault) {
      what.append(made("span", { class: "broke" }, `✗ ${story.ending.headline.split(", ")[0]}`));
    }
    if (!what.childNodes.length) what.append(made("span", { class: "quiet" }, ["skip", "blocked"].includes(deed.kind) || (story.ending.kind === "step" && moment.robot !== null) ? "" : "nothing changes"));
    const did = deed.kind === "environment" || deed.kind === "start" ? "" : deed.words;
    return made("li", { class: deed.kind, onclick: () => go(k) }, made("span", { class: "who" }, who), made("span", { class: "did" }, did), what);
  }
}

const short = (value) => String(Math.round(value * 1e6) / 1e6);
