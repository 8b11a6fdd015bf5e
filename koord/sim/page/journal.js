// The log: what happened, by kinds and words that are asked for.

const LOGGED = 300; // so many entries are listed at a time, around the time that is shown
const KINDS = [["bad", "Violations"], ["task", "Tasks"], ["said", "Output"], ["edit", "Edits"], ["event", "Events"], ["lock", "Locks"]];

class Journal {
  constructor(run, page, redraw) {
    this.run = run;
    this.page = page;
    this.redraw = redraw;
    this.kinds = new Set(["bad", "task", "said", "edit"]);
    this.own = false; // the chosen robot alone
    this.words = "";
    this.key = "";
    this.list = made("ul", { class: "log" });
    this.rest = made("p", { class: "quiet" });
    const again = () => { this.key = ""; this.redraw(); };
    this.chips = KINDS.map(([kind, name]) => made("button", {
      class: "chip", "aria-pressed": String(this.kinds.has(kind)), "data-kind": kind,
      onclick: (event) => {
        if (!this.kinds.delete(kind)) this.kinds.add(kind);
        event.currentTarget.setAttribute("aria-pressed", String(this.kinds.has(kind)));
        again();
      },
    }, name));
    this.mine = made("button", {
      class: "chip", "aria-pressed": "false",
      onclick: (event) => { this.own = !this.own; event.currentTarget.setAttribute("aria-pressed", String(this.own)); again(); },
    }, "Chosen robot only");
    this.search = made("input", { type: "search", placeholder: "words", "aria-label": "Entries with these words", oninput: () => { this.words = this.search.value.toLowerCase(); again(); } });
    this.head = made("div", { class: "filters", role: "group", "aria-label": "What is listed" }, ...this.chips, this.mine, this.search);
  }

  /** All entries of the kinds that are asked for, in order of time: {time, kind, mark, words, robot}. */
  entries() {
    const { run } = this, found = [];
    const has = (kind) => this.kinds.has(kind);
    if (has("bad")) {
      for (const one of run.violations) found.push({ time: one.time, mark: `▲ ${one.claim}`, words: storyOf(run, one), robot: one.robots[0], robots: one.robots });
      for (const one of run.still) found.push({ time: one.time, mark: `■ robot ${one.robot} stands still`, words: stillStory(one), robot: one.robot });
    }
    if (has("task")) {
      for (const one of run.tasks) found.push({ time: one.time, words: one.state === DONE ? `task ${one.task} done by robot ${one.robot}` : `task ${one.task} assigned to robot ${one.robot}`, robot: one.robot });
    }
    if (has("edit")) {
      for (const one of run.reloads) {
        const [mark, words] = reloadStory(one);
        found.push({ time: one.time, mark: `✎ ${mark}`, isGood: !one.isRefused, words });
      }
    }
    if (has("said")) for (const one of run.said) found.push({ time: one.time, words: `robot ${one.robot} ${one.stream}: ${one.text}`, robot: one.robot });
    if (has("event") || has("lock")) {
      for (let round = 0; round < run.rounds; round++) {
        if (run.roundNumbers[round] < 0) continue;
        for (let robot = 0; robot < run.count; robot++) {
          const deed = run.deed(robot, round);
          if (deed >= 0 && has("event")) found.push({ time: run.roundTimes[round], words: `robot ${robot} runs ${run.events(robot)[deed]}`, robot, deed: run.lookOf(robot, deed) });
          else if (deed === BLOCKED && has("lock")) found.push({ time: run.roundTimes[round], words: `robot ${robot} is kept out by a lock`, robot, deed });
        }
      }
    }
    if (run.ending) found.push({ time: run.duration, words: `the end: ${run.ending}` });
    const isMine = (one) => !this.own || one.robot === undefined || one.robot === this.page.chosen || one.robots?.includes(this.page.chosen);
    const says = (one) => !this.words || `${one.mark ?? ""} ${one.words}`.toLowerCase().includes(this.words);
    return found.filter((one) => isMine(one) && says(one)).sort((a, b) => a.time - b.time);
  }

  draw(pane) {
    const { run, page } = this;
    if (pane.firstChild !== this.head) pane.replaceChildren(this.head, this.list, this.rest);
    this.head.querySelector('[data-kind="edit"]').hidden = !run.reloads.length;
    const key = [run.rounds, run.samples, run.violations.length, run.reloads.length, run.ending, this.own ? page.chosen : "", document.documentElement.dataset.theme].join();
    if (key !== this.key) {
      this.key = key;
      this.found = this.entries();
      this.first = -1;
    }
    const at = this.found.findIndex((one) => one.time > page.time + 1e-6);
    const now = at < 0 ? this.found.length : at;
    const first = Math.max(0, Math.min(now - LOGGED / 2, this.found.length - LOGGED));
    if (first !== this.first || !this.list.childNodes.length) {
      this.first = first;
      this.shown = this.found.slice(first, first + LOGGED);
      this.list.replaceChildren(...this.shown.map((one) => this.item(one)));
    }
    this.shown.forEach((one, k) => this.list.children[k].classList.toggle("later", one.time > page.time + 1e-6));
    const more = this.found.length - this.shown.length;
    this.rest.textContent = this.found.length ? (more > 0 ? `${more} more before and after` : "") : "Nothing of this happened.";
  }

  item(one) {
    const swatch = made("canvas", { "aria-hidden": "true" });
    if (one.deed !== undefined) drawDeed(fitted(swatch, 12, 12), one.deed, 0, 12, 0, 12);
    return made("li", {},
      made("button", { onclick: () => { if (one.robot !== undefined) this.page.choose(one.robot); this.page.seek(one.time); } },
        made("time", {}, clock(one.time)),
        made("span", {}, ...(one.deed !== undefined ? [swatch, " "] : []), ...(one.mark ? [made("b", { class: one.isGood ? null : "bad" }, one.mark), " "] : []), one.words)));
  }
}
