// The texts of the program with the event that runs and what is broken; and all values.

class Texts {
  constructor(view) {
    this.view = view;
    this.tab = 0;
    const { texts } = view.telling.story;
    this.names = [...texts.map((text) => shortName(text.name)), "Values"];
    this.tabs = made("div", { class: "tabs", role: "tablist", "aria-label": "Texts and values" });
    this.pane = made("div", { class: "pane", role: "tabpanel", tabindex: "0" });
    this.element = made("section", { class: "panel texts", "aria-label": "Program and values" }, this.tabs, this.pane);
    this.tabs.append(...this.names.map((name, k) => made("button", { role: "tab", onclick: () => this.show(k) }, name)));
    this.tabs.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!by) return;
      event.stopPropagation();
      event.preventDefault();
      this.show((this.tab + by + this.names.length) % this.names.length);
      this.tabs.children[this.tab].focus();
    });
    this.codes = texts.map((text) => this.code(text));
    this.show(0);
  }

  show(tab) {
    this.tab = tab;
    [...this.tabs.children].forEach((button, k) => {
      button.setAttribute("aria-selected", String(k === tab));
      button.setAttribute("tabindex", k === tab ? "0" : "-1");
    });
    this.pane.setAttribute("aria-label", this.names[tab]);
    this.marked = null;
    this.mark();
  }

  code(text) {
    const { place } = this.view.telling.story.ending;
    const isBlamed = (line) => place && place.file === text.name && line >= place.line && line <= place.end_line - (place.end_column === 1 && place.end_line > place.line ? 1 : 0);
    return made("pre", { class: "code" }, ...text.text.split("\n").map((line, k) =>
      made("span", { class: `line${/^\s*#/.test(line) ? " comment" : ""}${isBlamed(k + 1) ? " blamed" : ""}` }, line || "\u200b")));
  }

  mark() {
    const { telling, position } = this.view, { texts } = telling.story;
    if (this.tab === texts.length) {
      this.values();
      return;
    }
    const code = this.codes[this.tab];
    if (this.pane.firstChild !== code || this.pane.childNodes.length > 1) this.pane.replaceChildren(code);
    const moment = telling.moments[position];
    const fault = moment.fault?.place, event = moment.robot === null ? null : telling.eventOf(moment)?.place;
    const place = [fault, event].find((one) => one && one.file === texts[this.tab].name) ?? null;
    const key = place ? `${place.line}-${place.end_line}` : "";
    if (key === this.marked) return;
    this.marked = key;
    for (const line of code.querySelectorAll(".runs")) line.classList.remove("runs");
    if (place) {
      const last = place.end_line - (place.end_column === 1 && place.end_line > place.line ? 1 : 0);
      for (let k = place.line; k <= last; k++) code.children[k - 1]?.classList.add("runs");
    }
    this.reveal();
  }

  /** Scrolls to the event that runs, or else to what is broken. */
  reveal() {
    const shown = this.pane.querySelector(".runs") ?? (this.pane.scrollTop ? null : this.pane.querySelector(".blamed"));
    if (!shown) return;
    const top = shown.getBoundingClientRect().top - this.pane.getBoundingClientRect().top;
    if (top < 0 || top > this.pane.clientHeight - 60) this.pane.scrollTop += top - 40;
  }

  values() {
    const { telling, position } = this.view, { story } = telling;
    const after = telling.valuesAfter(position), moved = new Set(telling.moments[position].changes.map(({ row }) => row));
    const table = made("table", { class: "values" });
    let group = "";
    story.rows.forEach((row, k) => {
      if (row.home === "status" && !telling.moving.has(k)) return;
      const of = row.robot === null ? "shared" : `of ${telling.robot(row.robot).words}`;
      if (of !== group) table.append(made("tr", {}, made("th", { colspan: "2", scope: "colgroup" }, of)));
      group = of;
      table.append(made("tr", { class: `${moved.has(k) ? "changed" : ""}${row.is_read ? " read" : ""}` },
        made("td", { title: row.is_read ? "the claim reads it" : row.home }, row.name), made("td", {}, after[k])));
    });
    const scrolled = this.pane.scrollTop;
    this.pane.replaceChildren(table);
    this.pane.scrollTop = scrolled;
  }
}
