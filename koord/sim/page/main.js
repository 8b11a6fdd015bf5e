// The page: time, keys, and what is drawn when.

const FOLLOW_S = 0.2; // so far behind a live run stays what is shown
const EDIT_S = 6; // so long an edit of the program is told of
const PANELS_MS = 150; // while it plays, numbers change no more often than one can read

class Page {
  constructor(run) {
    this.run = run;
    this.time = 0;
    this.chosen = run.count <= CHIPS ? 0 : -1;
    this.speed = 1;
    this.isPlaying = false;
    this.follows = false; // stays at the end while the run goes on
    this.isDirty = true;
    this.drawn = 0; // frames so far
    this.panelsAt = 0;
    this.clock = ""; // what it says
    this.map = new WorldMap(run, byId("map"));
    this.timeline = new Timeline(run, byId("timeline"));
    this.panels = new Panels(run, this);
    this.fillBar();
    this.fillLayers();
    this.fillEvents();
    this.fillSpeeds();
    listen(this);
    this.fromAddress();
    this.paintPlay();
    this.last = performance.now();
    requestAnimationFrame((now) => this.frame(now));
  }

  get round() { return this.run.roundAt(this.time); }

  // --- what can be done -------------------------------------------------------------------------

  play(on = !this.isPlaying) {
    if (on && !this.follows && this.time >= this.run.duration - 1e-6) this.time = 0;
    this.isPlaying = on;
    this.paintPlay();
    this.redraw();
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.run.duration);
    this.follows = this.isLive && this.time >= this.run.duration - 1e-6;
    this.redraw();
  }

  /** So many rounds on, or back. */
  step(rounds) {
    this.play(false);
    const { run } = this, to = Math.min(Math.max(this.round + rounds, 0), run.rounds - 1);
    const time = run.rounds ? run.roundTimes[to] : 0;
    this.seek(rounds > 0 && this.round + rounds >= run.rounds ? run.duration : time);
  }

  faster(by) {
    const at = SPEEDS.indexOf(this.speed);
    this.setSpeed(SPEEDS[Math.min(Math.max(at + by, 0), SPEEDS.length - 1)]);
  }

  setSpeed(speed) {
    this.speed = speed;
    byId("speed").value = String(speed);
  }

  choose(robot) {
    this.chosen = robot;
    this.redraw();
  }

  /** To the next violation, or to the one before. */
  toViolation(by) {
    const times = this.run.violations.map((one) => one.time);
    const found = by > 0 ? times.find((time) => time > this.time + 1e-6)
      : times.findLast((time) => time < this.time - 1e-6);
    if (found === undefined) return;
    this.play(false);
    const violation = this.run.violations.find((one) => one.time === found);
    if (violation.robots.length) this.chosen = violation.robots[0];
    this.seek(found);
  }

  switchTheme() {
    switchTheme();
    this.changedTheme();
  }

  changedTheme() {
    hatching = null;
    this.map.forget();
    this.map.ground.key = "";
    this.fillEvents();
    this.panels.paintIcons();
    this.redraw();
  }

  redraw() {
    this.isDirty = true;
    this.panelsAt = 0;
  }

  // --- frames -----------------------------------------------------------------------------------

  frame(now) {
    const passed = Math.min((now - this.last) / 1000, 0.25);
    this.last = now;
    if (this.follows && this.time !== this.run.duration) {
      // Packs come now and then; what is shown goes on without jerks.
      const behind = this.run.duration - this.time;
      this.time = behind < 1e-3 ? this.run.duration : this.time + behind * (1 - Math.exp(-passed / FOLLOW_S));
      this.isDirty = true;
    } else if (this.isPlaying) {
      this.time += passed * this.speed;
      this.isDirty = true;
      if (this.time >= this.run.duration) {
        this.time = this.run.duration;
        this.play(false);
      }
    }
    if (this.isDirty) {
      this.isDirty = false;
      this.draw(now);
    }
    requestAnimationFrame((next) => this.frame(next));
  }

  draw(now) {
    this.map.draw(this.time, this.chosen);
    this.timeline.draw(this.time, this.chosen);
    this.paintClock();
    if (now - this.panelsAt > PANELS_MS || !(this.isPlaying || this.follows)) {
      this.panelsAt = now;
      this.panels.draw();
      this.paintLegend();
      this.paintToast();
    }
    this.drawn++;
  }

  paintClock() {
    const { run, round } = this, told = roundWords(run, round);
    const words = `<b>${clock(this.time)}</b> / ${clock(run.duration)} · ${told}`;
    if (words === this.clock) return; // a frame need not change the document
    byId("clock").innerHTML = this.clock = words;
    const box = byId("timeline");
    box.setAttribute("aria-valuenow", this.time.toFixed(1));
    box.setAttribute("aria-valuemax", run.duration.toFixed(1));
    box.setAttribute("aria-valuetext", `${this.time.toFixed(1)} seconds, ${told}`);
  }

  paintPlay() {
    const button = byId("play");
    button.setAttribute("aria-label", this.isPlaying ? "Pause" : "Play");
    button.innerHTML = this.isPlaying
      ? '<svg viewBox="0 0 20 20" aria-hidden="true"><path d="M5 3h4v14H5zM11 3h4v14h-4z" fill="currentColor"/></svg>'
      : '<svg viewBox="0 0 20 20" aria-hidden="true"><path d="M6 3l11 7-11 7z" fill="currentColor"/></svg>';
  }

  paintToast() {
    const toast = byId("toast");
    const near = this.run.violations.filter((one) => one.time <= this.time + 1e-6 && this.time - one.time < 1.5);
    const still = this.run.still.filter((one) => one.time <= this.time + 1e-6 && this.time - one.time < 1.5);
    const edits = this.run.reloads.filter((one) => one.time <= this.time + 1e-6 && this.time - one.time < EDIT_S);
    toast.hidden = !near.length && !still.length && !edits.length;
    toast.classList.toggle("good", !near.length && !still.length && edits.length > 0 && !edits[edits.length - 1].isRefused);
    toast.style.bottom = `${8 + (this.map.shown.side ? SIDE_HEIGHT : 0)}px`;
    if (toast.hidden) return;
    if (!near.length && !still.length) {
      const [mark, words] = reloadStory(edits[edits.length - 1]);
      toast.replaceChildren(made("b", {}, `✎ ${mark}`), ` ${words}`);
      return;
    }
    if (!near.length) {
      const [one] = still.slice(-1);
      toast.replaceChildren(made("b", {}, `■ robot ${one.robot} stands still`), ` ${stillStory(one)}`);
      return;
    }
    const shown = near[near.length - 1], others = near.filter((one) => one.time === shown.time).length - 1;
    const more = others ? ` — and ${others} more, see Log` : "";
    toast.replaceChildren(made("b", {}, `▲ ${shown.claim}`), ` ${storyOf(this.run, shown)}${more}`);
  }

  // --- what stands around -----------------------------------------------------------------------

  fillBar() {
    const { run } = this, { header } = run;
    byId("program").textContent = shortName(header.program);
    byId("program").title = header.program;
    const looks = new Map();
    for (const robot of run.robots) looks.set(robot.device, (looks.get(robot.device) ?? 0) + 1);
    const fleet = [...looks].map(([look, count]) => `${count} ${look}${count > 1 && !look.endsWith("s") ? "s" : ""}`).join(", ");
    const facts = [
      ["", made("b", {}, String(run.count)), ` robot${run.count === 1 ? "" : "s"} (${fleet})`],
      ["", made("b", {}, clock(run.duration)), ""],
      ["", "δ ", made("b", {}, `${header.delta} s`)],
      ["", "seed ", made("b", {}, String(header.seed))],
      ...header.differing.map((words) => ["", words]),
    ];
    const done = run.tasksAt(run.duration).filter((one) => one.state === DONE).length;
    const all = header.world.tasks.length;
    if (all) facts.push([done === all ? "good" : "", made("b", {}, `${done} of ${all}`), " tasks done"]);
    if (run.violations.length) {
      facts.push(["bad", made("b", {}, `▲ ${run.violations.length}`), ` violation${run.violations.length > 1 ? "s" : ""}`]);
    }
    if (run.still.length) {
      const stuck = new Set(run.still.map((one) => one.robot)).size;
      facts.push(["bad", made("b", {}, `■ ${stuck}`), ` robot${stuck > 1 ? "s" : ""} stood still`]);
    }
    if (run.ending) facts.push(["", run.ending]);
    byId("facts").replaceChildren(...facts.map(([kind, ...words]) => made("li", { class: kind || null }, ...words)));
    const jump = byId("violations");
    jump.hidden = run.violations.length === 0;
    jump.replaceChildren(`▲ ${run.violations.length}`, made("span", { class: "wide-only" }, ` violation${run.violations.length > 1 ? "s" : ""}`));
    jump.setAttribute("aria-label", `${run.violations.length} violation${run.violations.length > 1 ? "s" : ""}: to the next one`);
    byId("map").setAttribute("aria-label",
      `${header.program}: ${run.count} robots in a world of ${metres(header.world.high[0] - header.world.low[0])} by ${metres(header.world.high[1] - header.world.low[1])}`);
  }

  fillLayers() {
    const box = byId("layers");
    box.replaceChildren(...LAYERS.filter(([layer]) =>
      (layer !== "side" || this.map.hasHeights()) && (layer !== "safety" || this.run.header.safety > 0))
      .map(([layer, name]) => made("button", {
        "aria-pressed": String(this.map.shown[layer]),
        onclick: (event) => {
          this.map.shown[layer] = !this.map.shown[layer];
          event.currentTarget.setAttribute("aria-pressed", String(this.map.shown[layer]));
          if (layer === "side") {
            byId("stage").classList.toggle("sided", this.map.shown.side);
            if (this.map.isFitted) this.map.fit();
          }
          this.redraw();
        },
      }, name)));
  }

  fillEvents() {
    const entries = this.run.eventNames.map((name, k) => [k, name]);
    entries.push([BLOCKED, "kept out by a lock"], [STOPPED, "stopped"]);
    byId("events").replaceChildren(...entries.map(([deed, name]) => {
      const swatch = made("canvas");
      drawDeed(fitted(swatch, 14, 14), deed, 1, 12, 1, 12);
      return made("li", {}, swatch, name);
    }));
  }

  paintLegend() {
    const box = byId("legend"), { run } = this, { map } = run.header;
    const tasks = run.header.world.tasks.length ? ["open", "assigned", "done"] : [];
    const cells = map ? ["unknown", "free", "wall"] : [];
    box.hidden = !tasks.length && !cells.length;
    if (box.hidden) return;
    if (box.dataset.theme !== document.documentElement.dataset.theme) {
      box.dataset.theme = document.documentElement.dataset.theme;
      const entry = (name, draw) => {
        const icon = made("canvas");
        draw(fitted(icon, 20, 20));
        return made("div", {}, icon, name, made("b"));
      };
      box.replaceChildren(
        ...tasks.map((name, state) => entry(name, (pen) => drawTask(pen, 10, 10, 7, state))),
        ...cells.map((name) => entry(name, (pen) => drawCell(pen, name))));
    }
    const counts = tasks.map((_, state) => run.tasksAt(this.time).filter((task) => task.state === state).length);
    if (map) {
      const states = cellStates(map, run.shared[map.variable].at(this.round));
      counts.push(...cells.map((name) => states.filter((state) => state === name).length));
    }
    counts.forEach((count, k) => { box.children[k].querySelector("b").textContent = count; });
  }

  fillSpeeds() {
    const select = byId("speed");
    select.replaceChildren(...SPEEDS.map((speed) => made("option", { value: speed }, `${speed}×`)));
    select.addEventListener("change", () => this.setSpeed(Number(select.value)));
    const { duration } = this.run;
    this.setSpeed(duration > 60 ? 4 : duration > 20 ? 2 : 1);
  }

  /** `#t=12.5&robot=2` in the address: where to begin. */
  fromAddress() {
    const wanted = new URLSearchParams(location.hash.slice(1));
    const robot = Number(wanted.get("robot") ?? NaN), time = Number(wanted.get("t") ?? NaN);
    if (Number.isInteger(robot) && robot >= 0 && robot < this.run.count) this.choose(robot);
    if (Number.isFinite(time)) this.seek(time);
  }

  // --- live -------------------------------------------------------------------------------------

  /** More of the run has come. */
  grow(pack) {
    this.run.append(pack);
    this.fillBar();
    if (pack.reloads) {
      this.fillEvents();
      this.panels.plot.refill();
    }
    if (this.timeline.layout().reduce((sum, [, h]) => sum + h + 2, 8) !== this.timeline.height) this.resize();
    this.redraw();
  }

  setLive(on, word) {
    this.isLive = on;
    if (!on) this.follows = false;
    byId("live").hidden = false;
    byId("live").classList.toggle("on", on);
    byId("live-word").textContent = word;
    this.redraw();
  }

  resize() {
    byId("stage").classList.toggle("sided", this.map.shown.side);
    this.timeline.resize();
    this.map.resize();
    this.redraw();
  }
}

async function begin() {
  followTheme(() => window.page?.changedTheme());
  const text = byId("data").textContent;
  if (text.trim() === "packs") {
    document.addEventListener("DOMContentLoaded", readPacks);
  } else if (text.trim()) {
    window.page = new Page(new Run(unpacked(await inflated(text))));
  } else {
    listenLive();
  }
}

/** A page of a run that was cut off: its packs stand behind the page, and the last may be broken. */
function readPacks() {
  let run = null;
  for (const element of document.querySelectorAll("script.pack")) {
    try {
      const pack = unpacked(fromBase64(element.textContent));
      if (run) run.append(pack);
      else run = new Run(pack);
    } catch {
      break;
    }
  }
  if (!run) return;
  run.ending ??= "the run was cut off here";
  window.page = new Page(run);
}

/** A page without data is served while the run goes on: its packs come one after the other. */
function listenLive() {
  const source = new EventSource("packs");
  source.addEventListener("pack", (event) => {
    const pack = unpacked(fromBase64(event.data));
    if (pack.header) {
      if (window.page) location.reload(); // the server begins anew
      window.page = new Page(new Run(pack));
      window.page.setLive(true, "live");
      window.page.follows = true;
    } else {
      window.page.grow(pack);
    }
    if (pack.ending) {
      source.close();
      window.page.setLive(false, "over");
    }
  });
  source.addEventListener("error", () => {
    if (source.readyState === EventSource.CLOSED || !window.page) return;
    source.close();
    window.page.setLive(false, "connection lost");
  });
}

begin();
