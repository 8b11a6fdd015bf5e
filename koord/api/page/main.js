// The page: which story is looked at, and at which turn.

const TURN_MS = 700;

class View {
  constructor(page, story) {
    this.page = page;
    this.telling = new Telling(story);
    this.position = Math.min(story.ending.moment, story.moments.length - 1);
    if (story.loop || story.ending.kind === "done") this.position = 0;
    this.laps = 0;
    this.go = (position) => page.go(position);
    this.lanes = new Lanes(this);
    this.parts = [this.lanes, new Turns(this), new Why(this), new Sky(this), new Texts(this)];
  }

  get elements() {
    const [lanes, turns, why, sky, texts] = this.parts;
    const used = (part) => (part.isUsed === false ? [] : [part.element]);
    return [
      this.banner(),
      made("div", { class: "column" }, lanes.element, turns.element, ...used(sky)),
      made("div", { class: "column" }, ...used(why), texts.element),
    ];
  }

  banner() {
    const { ending } = this.telling.story, isBad = ending.kind !== "done";
    const banner = made("section", { class: `banner${isBad ? " bad" : ""}`, "aria-label": "How it ends" },
      made("p", { class: "headline" }, made("b", {}, isBad ? "✗ " : ""), ending.headline, ending.rule ? made("span", { class: "rule" }, `  [${ending.rule}]`) : ""));
    if (ending.detail) banner.append(made("p", { class: "detail" }, ending.detail));
    if (ending.differences.length) {
      banner.append(made("table", { class: "differences" },
        made("tr", {}, ...["", ending.expected_as, ending.found_as].map((name) => made("th", { scope: "col" }, name))),
        ...ending.differences.map((one) => made("tr", {}, made("th", { scope: "row" }, one.robot === null ? one.name : `${one.name} of robot ${one.robot}`), made("td", {}, one.expected), made("td", {}, one.found)))));
    }
    for (const note of ending.notes) banner.append(made("p", { class: "note" }, note));
    return banner;
  }

  mark() { for (const part of this.parts) part.mark(); }

  /** Once it is in the document, what is looked at is scrolled into sight. */
  attached() {
    this.lanes.reveal();
    this.parts[4].reveal();
  }
}

class Page {
  constructor(shown) {
    this.shown = shown;
    this.view = null;
    this.at = -1;
    this.timer = 0;
    this.views = new Map();
    this.listen();
    this.fromAddress();
  }

  // --- what is shown ----------------------------------------------------------------------------

  /** `#story=2&turn=5` in the address. */
  fromAddress() {
    const wanted = new URLSearchParams(location.hash.slice(1));
    const story = Number(wanted.get("story") ?? NaN), turn = Number(wanted.get("turn") ?? NaN);
    if (Number.isInteger(story) && this.shown.stories[story]) this.open(story, turn);
    else if (this.shown.verifications.length) this.overview();
    else this.open(0, turn);
  }

  overview() {
    this.play(false);
    this.view = null;
    this.at = -1;
    const main = byId("content");
    main.className = "overview";
    main.replaceChildren(...new Overview(this.shown).draw());
    this.head(document.title.split(", ").map(shortName).join(", "), this.shown.verifications.length > 1 ? plural(this.shown.verifications.length, "verification") : "");
    byId("up").hidden = true;
    byId("transport").hidden = true;
  }

  open(story, turn = NaN) {
    this.play(false);
    if (this.at !== story) {
      this.at = story;
      if (!this.views.has(story)) this.views.set(story, new View(this, this.shown.stories[story]));
      this.view = this.views.get(story);
      const main = byId("content");
      main.className = "story";
      main.replaceChildren(...this.view.elements);
      const { title, about } = this.view.telling.story;
      this.head(title, about);
      byId("up").hidden = !this.shown.verifications.length;
      this.programs(story);
      byId("transport").hidden = false;
      byId("slider").max = String(this.view.telling.moments.length - 1);
      const { ending } = this.view.telling.story;
      byId("break").hidden = !["violated", "fault", "refused", "step"].includes(ending.kind);
    }
    this.view.laps = 0;
    this.go(Number.isInteger(turn) ? turn : this.view.position);
    this.view.attached();
  }

  /** The stories of a run that went on with another program, one for each. */
  programs(shown) {
    const { stories, verifications } = this.shown, nav = byId("programs");
    nav.hidden = verifications.length > 0 || stories.length < 2;
    if (nav.hidden) return;
    nav.replaceChildren(...stories.map((one, at) => {
      const numbers = one.moments.map(({ round }) => round).filter((round) => round > 0);
      const rounds = numbers.length ? `rounds ${numbers[0]} to ${numbers[numbers.length - 1]}` : "no round";
      return made("a", { href: `#story=${at}`, "aria-current": at === shown ? "page" : null }, `${one.title}: ${rounds}`);
    }));
  }

  head(title, about) {
    byId("title").textContent = title;
    byId("title").title = title;
    byId("about").textContent = about;
    byId("about").title = about;
  }

  // --- turns ------------------------------------------------------------------------------------

  go(position) {
    const { view } = this, last = view.telling.moments.length - 1;
    view.position = Math.min(Math.max(position, 0), last);
    const moment = view.telling.moments[view.position], total = view.telling.rounds[view.telling.rounds.length - 1].number;
    const where = moment.round === 0 ? (view.telling.story.ending.kind === "step" ? "before" : "the start") : `round ${moment.round} of ${total}`;
    const lap = view.laps ? `, lap ${view.laps + 1}` : "";
    const what = moment.round === 0 ? "" : ` · ${view.telling.words(view.position)}`;
    byId("clock").replaceChildren(made("b", {}, where + lap), what);
    const slider = byId("slider");
    slider.value = String(view.position);
    slider.setAttribute("aria-valuetext", `${where}${lap}${what}`);
    view.mark();
  }

  /** So many turns on; behind the end of a loop it goes on at its beginning. */
  step(by) {
    const { view } = this, { telling } = view, { loop } = telling.story;
    const last = telling.moments.length - 1, to = view.position + by;
    if (!loop || (to <= last && to >= 0)) {
      const first = loop ? telling.rounds[telling.roundOf.get(loop.first)]?.turns[0] : undefined;
      if (loop && by < 0 && view.laps && view.position === first) {
        view.laps--;
        this.go(last);
      } else this.go(to);
      return;
    }
    if (to > last) {
      view.laps++;
      this.go(telling.rounds[telling.roundOf.get(loop.first)].turns[0]);
    }
  }

  /** To the end of the next round, or of the one before. */
  stepRound(by) {
    const { view } = this, { telling } = view, at = telling.roundOf.get(telling.moments[view.position].round);
    const here = telling.endOf(telling.rounds[at]);
    if (by > 0 && view.position < here) this.go(here);
    else if (by > 0 && at + 1 === telling.rounds.length) this.step(1);
    else this.go(telling.endOf(telling.rounds[Math.min(Math.max(at + by, 0), telling.rounds.length - 1)]));
  }

  play(on = !this.timer) {
    clearInterval(this.timer);
    this.timer = 0;
    if (on && this.view) {
      const last = this.view.telling.moments.length - 1;
      if (this.view.position === last && !this.view.telling.story.loop) this.go(0);
      this.timer = setInterval(() => {
        const { view } = this;
        if (view.position >= view.telling.moments.length - 1 && !view.telling.story.loop) this.play(false);
        else this.step(1);
      }, TURN_MS);
    }
    const button = byId("play");
    button.setAttribute("aria-label", this.timer ? "Pause" : "Play");
    button.innerHTML = this.timer
      ? '<svg viewBox="0 0 20 20" aria-hidden="true"><path d="M5 3h4v14H5zM11 3h4v14h-4z" fill="currentColor"/></svg>'
      : '<svg viewBox="0 0 20 20" aria-hidden="true"><path d="M6 3l11 7-11 7z" fill="currentColor"/></svg>';
  }

  toBreak() {
    this.play(false);
    this.go(this.view.telling.story.ending.moment);
  }

  // --- hands ------------------------------------------------------------------------------------

  listen() {
    const by = (id, action) => byId(id).addEventListener("click", action);
    by("first", () => { this.play(false); this.go(0); });
    by("last", () => { this.play(false); this.go(Infinity); });
    by("back", () => { this.play(false); this.step(-1); });
    by("forth", () => { this.play(false); this.step(1); });
    by("play", () => this.play());
    by("break", () => this.toBreak());
    by("theme", switchTheme);
    by("help", () => byId("keys").showModal());
    by("up", (event) => { event.preventDefault(); location.hash = ""; });
    // In a frame that shows this page by `srcdoc` a link leads to another page: that around it.
    byId("content").addEventListener("click", (event) => {
      const link = event.target.closest("a.look");
      if (!link || event.ctrlKey || event.metaKey || event.shiftKey) return;
      event.preventDefault();
      location.hash = link.getAttribute("href");
    });
    byId("slider").addEventListener("input", (event) => { this.play(false); this.go(Number(event.target.value)); });
    // `#content` is a jump within what is shown.
    window.addEventListener("hashchange", () => { if (location.hash !== "#content") this.fromAddress(); });
    document.addEventListener("keydown", (event) => this.pressed(event));
  }

  pressed(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || byId("keys").open) return;
    if (event.key === " " && event.target.matches("button:focus-visible, summary, a")) return;
    const inStory = {
      ArrowLeft: () => (event.shiftKey ? this.stepRound(-1) : this.step(-1)),
      ArrowRight: () => (event.shiftKey ? this.stepRound(1) : this.step(1)),
      Home: () => this.go(0),
      End: () => this.go(Infinity),
      b: () => this.toBreak(),
      " ": () => this.play(),
      Escape: () => { if (this.shown.verifications.length) location.hash = ""; },
      n: () => this.another(1),
      p: () => this.another(-1),
    };
    const anywhere = { d: switchTheme, "?": () => byId("keys").showModal() };
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const action = (this.view && inStory[key]) || anywhere[key];
    if (!action) return;
    event.preventDefault();
    if (key !== " ") this.play(false);
    action();
  }

  another(by) {
    const to = this.at + by;
    if (this.shown.stories[to]) location.hash = `story=${to}`;
  }
}

function begin() {
  followTheme();
  window.page = new Page(JSON.parse(byId("data").textContent));
}

begin();
