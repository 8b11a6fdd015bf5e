// The editor: a text area whose letters are not seen, above the same text in colours.

const INDENT = "    ";

/** What is seen of verdicts, by the kinds that they are of. */
const MARKS = { holds: "✓", bounded: "✓", violated: "✗", unknown: "?", vacuous: "∅" };

const escaped = (text) => text.replace(/[&<>]/g, (sign) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;" })[sign]);

/** What words and signs are, from the list of words that the compiler has. */
class Colours {
  constructor(words) {
    this.kinds = new Map(Object.entries(words).flatMap(([kind, list]) => list.map((word) => [word, kind])));
    this.pattern = /(#.*|\/\/.*)|("(?:\\.|[^"\\\n])*"?)|(\b\d+(?:\.\d+)?(?:[eE][+-]?\d+)?\b)|([A-Za-z_]\w*)|([-+*/%<>=!≠≤≥]+)/g;
  }

  /** The pieces of a line, as [text, kind]. */
  pieces(line) {
    const pieces = [];
    let at = 0;
    for (const found of line.matchAll(this.pattern)) {
      if (found.index > at) pieces.push([line.slice(at, found.index), ""]);
      const [all, comment, string, number, name] = found;
      at = found.index + all.length;
      const kind = comment ? "comment" : string ? "string" : number ? "number" : name ? this.kindOf(name, line, found.index) : "sign";
      pieces.push([all, kind]);
    }
    pieces.push([line.slice(at), ""]);
    return pieces;
  }

  kindOf(name, line, at) {
    const rest = line.slice(at + name.length), kind = this.kinds.get(name);
    if (kind === "function" && !/^\s*\(/.test(rest)) return "";
    if (!kind && /^\s*:/.test(rest) && !line.slice(0, at).trim()) return "event";
    return kind ?? "";
  }
}

class Editor {
  constructor(words, changed) {
    this.area = byId("text");
    this.colours = new Colours(words);
    this.problems = [];
    this.marks = [];
    this.changed = changed;
    this.leaving = false;
    this.area.addEventListener("input", () => { this.problems = []; this.marks = []; this.draw(); this.changed(); });
    this.area.addEventListener("keydown", (event) => this.pressed(event));
  }

  get text() { return this.area.value; }

  /** Put another text in place of this one; what was there comes back by undoing. */
  set text(text) {
    if (text === this.text) return;
    this.area.focus({ preventScroll: true });
    this.area.select();
    if (!document.execCommand("insertText", false, text)) {
      this.area.value = text;
      this.area.dispatchEvent(new Event("input"));
    }
    this.area.setSelectionRange(0, 0);
    byId("editor").scrollTo(0, 0);
  }

  show(problems, marks) {
    this.problems = problems;
    this.marks = marks;
    this.draw();
  }

  /** Colour the text, line by line; what is wrong in a line is underlined. */
  draw() {
    const lines = this.text.split("\n");
    const marks = new Map(), wrong = new Map(), rank = ["holds", "bounded", "vacuous", "unknown", "violated"];
    for (const mark of this.marks) {
      const before = marks.get(mark.line);
      if (!before) marks.set(mark.line, { kind: mark.kind, titles: [mark.story] });
      else {
        before.titles.push(mark.story);
        if (rank.indexOf(mark.kind) > rank.indexOf(before.kind)) before.kind = mark.kind;
      }
    }
    for (const problem of this.problems) {
      for (let line = problem.line; line > 0 && line <= problem.end_line && line < problem.line + 50; line++) {
        wrong.set(line, [...(wrong.get(line) ?? []), problem]);
      }
    }
    byId("layer").innerHTML = lines.map((line, at) => this.line(line, at + 1, wrong.get(at + 1) ?? [], marks.get(at + 1))).join("\n") + "\n";
    byId("gutter").replaceChildren(...lines.map((_, at) => this.number(at + 1, wrong.get(at + 1), marks.get(at + 1))));
  }

  line(line, number, problems, mark) {
    // Columns count characters, and a text counts units of UTF-16.
    const inside = (problem, from, to) => {
      const begins = problem.line === number ? problem.column - 1 : 0;
      const ends = problem.end_line === number ? Math.max(problem.end_column - 1, begins + 1) : Infinity;
      return from < ends && to > begins;
    };
    let at = 0;
    const shown = this.colours.pieces(line).map(([text, kind]) => {
      const from = at;
      at += [...text].length;
      const found = text.trim() ? problems.filter((problem) => inside(problem, from, at)) : [];
      const under = found.some((problem) => problem.severity === "error") ? " wrong" : found.length ? " doubtful" : "";
      return kind || under ? `<span class="${kind}${under}">${escaped(text)}</span>` : escaped(text);
    }).join("");
    return mark?.kind === "violated" ? `<span class="line violated">${shown}</span>` : shown;
  }

  number(number, problems, mark) {
    const severity = problems ? (problems.some((one) => one.severity === "error") ? "error" : "warning") : "";
    const kind = severity || mark?.kind || "";
    const title = [...(problems ?? []).map((one) => one.message), ...(mark?.titles ?? [])].join("\n\n");
    const sign = severity ? "●" : MARKS[kind] ?? "";
    return made("div", { title: title || null }, made("b", { class: kind }, sign), String(number));
  }

  /** To a place of the text, which is selected. */
  go(line, column) {
    const lines = this.text.split("\n"), before = lines.slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
    const at = before + [...(lines[line - 1] ?? "")].slice(0, Math.max(column - 1, 0)).join("").length;
    this.area.focus({ preventScroll: true });
    this.area.setSelectionRange(at, at);
    byId("editor").scrollTo({ top: Math.max(0, (line - 6) * 20), behavior: "smooth" });
  }

  pressed(event) {
    const { area } = this, leaving = this.leaving;
    this.leaving = event.key === "Escape";
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Tab" && !event.shiftKey && !leaving) {
      event.preventDefault();
      document.execCommand("insertText", false, INDENT);
    } else if (event.key === "Enter") {
      event.preventDefault();
      const line = this.text.slice(0, area.selectionStart).split("\n").pop();
      const indent = /^\s*/.exec(line)[0] + (/:\s*(#.*)?$/.test(line) ? INDENT : "");
      document.execCommand("insertText", false, `\n${indent}`);
    }
  }
}
