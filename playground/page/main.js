// The page: a text, a worker that koord runs in, and what came of the last request.

const DRAFT = "koord playground";

/** koord in a worker; whoever cancels ends it, and begins another. */
class Koord {
  constructor(heard) {
    this.heard = heard;
    this.begin();
  }

  begin() {
    this.isReady = false;
    this.busy = null;
    this.worker = new Worker("worker.js", { type: "module" });
    this.worker.onmessage = ({ data }) => this.take(data);
    this.worker.onerror = (event) => this.heard({ kind: "failed", text: event.message || "the worker could not be loaded" });
  }

  take(data) {
    if (data.kind === "ready") this.isReady = true;
    if (data.kind === "answer" || data.kind === "failed") {
      data.asked = this.busy;
      this.busy = null;
    }
    this.heard(data);
  }

  ask(request) {
    this.busy = { ...request, began: performance.now() };
    this.worker.postMessage(request);
  }

  cancel() {
    this.worker.terminate();
    this.begin();
  }
}

class Playground {
  constructor({ words, examples, version }) {
    this.examples = examples;
    this.began = performance.now();
    this.next = null; // what is asked once koord is there
    this.timer = 0;
    this.shown = null; // the text that the result is of
    this.editor = new Editor(words, () => this.edited());
    this.koord = new Koord((data) => this.hear(data));
    byId("version").textContent = `koord ${version}`;
    this.listExamples();
    this.listen();
    this.start();
  }

  // --- the text ---------------------------------------------------------------------------------

  listExamples() {
    const groups = new Map();
    for (const { name, group } of this.examples) groups.set(group, [...(groups.get(group) ?? []), name]);
    byId("example").append(made("option", { value: "" }, "your program"));
    for (const [group, names] of groups) {
      byId("example").append(made("optgroup", { label: group }, ...names.map((name) => made("option", { value: name }, name))));
    }
  }

  /** The text that a link carries, or that was there last, or the first example. */
  async start() {
    if (location.hash.length > 1) await this.follow();
    else {
      const draft = this.draft();
      if (draft) this.put(draft.text, draft);
    }
    if (!this.editor.text) this.example(this.examples[0].name);
    window.playground = this;
  }

  async follow() {
    try {
      const found = await linked(location.hash);
      if (found.text !== null) this.put(found.text, found);
      else if (this.examples.some(({ name }) => name === found.example)) this.example(found.example, found);
      else throw new Error("it names neither a program nor an example");
    } catch (error) {
      this.say(`This link holds no program: ${error.message}`, "failed");
    }
  }

  example(name, found = {}) {
    this.put(this.examples.find((one) => one.name === name).text, found);
    byId("example").value = name;
  }

  put(text, found) {
    for (const name of SETTINGS) {
      const field = byId(name);
      field.value = found[name] ?? USUAL[name];
      if (!field.value) field.value = USUAL[name]; // a link may say what a field cannot hold
    }
    this.tellMore();
    this.editor.text = text;
    const same = this.examples.find((one) => one.text === text);
    byId("example").value = same ? same.name : "";
  }

  get asked() {
    const number = (name) => Math.trunc(Number(byId(name).value)) || 0;
    return {
      text: this.editor.text, robots: byId("robots").value, rounds: number("rounds"),
      params: byId("params").value, policy: byId("policy").value, seed: number("seed"),
    };
  }

  edited() {
    byId("example").value = "";
    byId("problems").replaceChildren();
    this.mark();
    this.keep();
    this.checkSoon();
  }

  checkSoon() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.ask("check", true), 300);
  }

  /** Who does not see the further settings is told that they are not the usual ones. */
  tellMore() {
    byId("more").classList.toggle("set", ["params", "policy", "seed"].some((name) => byId(name).value !== USUAL[name]));
  }

  /** A text outlives the page; where nothing may be kept it does not. */
  keep() {
    try { localStorage.setItem(DRAFT, JSON.stringify(this.asked)); } catch { /* it is not ours to force */ }
  }

  draft() {
    try { return JSON.parse(localStorage.getItem(DRAFT)); } catch { return null; }
  }

  /** What is shown of another text than that which is there now is shown as such. */
  mark() {
    const isStale = this.shown !== null && this.shown !== this.editor.text;
    document.querySelector(".showing").classList.toggle("stale", isStale);
  }

  // --- requests ---------------------------------------------------------------------------------

  ask(what, isQuiet = false) {
    const request = { do: what, ...this.asked, isQuiet };
    if (this.koord.busy && !this.koord.busy.isQuiet) return;
    if (!this.koord.isReady || this.koord.busy) {
      if (!isQuiet || !this.next) this.next = request;
      this.buttons();
      return;
    }
    this.next = null;
    this.koord.ask(request);
    if (!isQuiet) this.say(`${what}: begun`, "busy");
    this.buttons();
  }

  cancel() {
    const what = this.koord.busy?.do ?? this.next?.do;
    this.next = null;
    if (this.koord.busy) this.koord.cancel();
    this.say(`${what ?? "nothing"}: cancelled; koord starts again`, "busy");
    this.buttons();
  }

  hear(data) {
    const isQuiet = this.koord.busy?.isQuiet;
    if (data.kind === "loading" && !this.next) this.say(data.text, "busy");
    else if (data.kind === "loading") this.say(`${this.next.do} follows; ${data.text}`, "busy");
    else if (data.kind === "progress" && !isQuiet) this.progress(data);
    else if (data.kind === "ready") this.say("ready", "ready");
    else if (data.kind === "failed") this.say(`koord failed, which is its own mistake: ${data.text}`, "failed");
    else if (data.kind === "answer") this.answer(data.asked, data.answer);
    if (["ready", "answer"].includes(data.kind)) {
      if (this.next) this.ask(this.next.do, this.next.isQuiet);
      else if (data.kind === "ready" || data.asked.text !== this.editor.text) this.ask("check", true);
    }
    this.buttons();
  }

  buttons() {
    const busy = (this.koord.busy && !this.koord.busy.isQuiet) || (this.next && !this.next.isQuiet);
    for (const id of ["check", "verify", "run"]) byId(id).disabled = Boolean(busy);
    byId("cancel").disabled = !busy;
  }

  // --- answers ----------------------------------------------------------------------------------

  /** What is being done, and the verdicts so far: they stay, whatever is found of other claims. */
  progress({ text, marks }) {
    const { busy } = this.koord;
    this.say(`${busy.do}: ${text}`, "busy");
    if (busy.text === this.editor.text && marks.length !== this.editor.marks.length) this.editor.show(this.editor.problems, marks);
    if (!marks.length) return;
    if (!byId("result").hidden) this.frame("");
    byId("welcome").hidden = true;
    byId("about").className = "about";
    byId("about").replaceChildren(...marks.map(({ name, kind }) => made("span", { class: `known ${kind}` }, `${MARKS[kind]} ${name}`)), made("small", {}, "so far"));
    this.shown = busy.text;
    this.mark();
  }

  answer(asked, answer) {
    if (asked.text === this.editor.text) this.editor.show(answer.problems, asked.isQuiet ? this.editor.marks : answer.marks);
    if (asked.text === this.editor.text) this.list(answer.problems);
    if (asked.isQuiet) return;
    const seconds = (performance.now() - asked.began) / 1000;
    this.say(`${asked.do}: done in ${seconds.toFixed(1)} s`, "ready");
    const signs = { holds: "✓", violated: "✗", refused: "✗", unknown: "?", done: "✓" };
    byId("about").className = `about ${answer.outcome}`;
    byId("about").replaceChildren(`${signs[answer.outcome]} ${answer.summary} `, made("small", {}, `${asked.do}, ${seconds.toFixed(1)} s`));
    this.last = answer;
    this.shown = asked.text;
    this.frame(answer.page);
    this.mark();
  }

  frame(page) {
    const old = byId("result"), frame = made("iframe", { id: "result", title: old.title, sandbox: "allow-scripts" });
    frame.hidden = !page;
    frame.style.colorScheme = document.documentElement.dataset.theme;
    if (page) frame.srcdoc = page;
    old.replaceWith(frame);
    byId("welcome").hidden = Boolean(page);
  }

  list(problems) {
    byId("problems").replaceChildren(...problems.map((one) => {
      const sign = one.severity === "error" ? "✗" : "!";
      const place = one.line ? `${one.line}:${one.column}` : "";
      return made("li", {}, made("button", { onclick: () => { if (one.line) this.editor.go(one.line, one.column); } },
        made("span", { class: one.severity }, sign), made("span", { class: "place" }, place),
        made("span", {}, one.message, " ", made("code", {}, one.code)), ...(one.hint ? [made("span", { class: "hint" }, one.hint)] : [])));
    }));
  }

  say(text, lamp) {
    byId("state").textContent = text;
    byId("state").title = text;
    byId("lamp").className = `lamp ${lamp}`;
  }

  // --- hands ------------------------------------------------------------------------------------

  listen() {
    for (const id of ["check", "verify", "run"]) byId(id).addEventListener("click", () => this.ask(id));
    byId("cancel").addEventListener("click", () => this.cancel());
    byId("example").addEventListener("change", ({ target }) => { if (target.value) this.example(target.value); });
    for (const id of SETTINGS) byId(id).addEventListener("input", () => { this.keep(); this.tellMore(); });
    byId("params").addEventListener("input", () => this.checkSoon());
    document.addEventListener("click", ({ target }) => { if (!byId("more").contains(target)) byId("more").open = false; });
    byId("link").addEventListener("click", () => this.link());
    byId("theme").addEventListener("click", () => { switchTheme(); this.theme(); });
    window.addEventListener("hashchange", () => this.follow());
    document.addEventListener("keydown", (event) => {
      if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) this.ask("verify");
    });
  }

  theme() { byId("result").style.colorScheme = document.documentElement.dataset.theme; }

  async link() {
    const address = await linkTo(this.asked);
    history.replaceState(null, "", address);
    try {
      await navigator.clipboard.writeText(address);
      this.say("the link is in the clipboard, and in the address bar", "ready");
    } catch {
      this.say("the link is in the address bar", "ready");
    }
  }
}

function begin() {
  followTheme(() => byId("result").style.setProperty("color-scheme", document.documentElement.dataset.theme));
  new Playground(JSON.parse(byId("data").textContent));
}

begin();
