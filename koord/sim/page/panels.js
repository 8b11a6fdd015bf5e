// What stands beside the world: robots to choose from, and what is known of the chosen one.

const CHIPS = 64; // more robots are chosen by number
const ROWS = 40; // more elements of a variable are not listed

class Panels {
  constructor(run, page) {
    this.run = run;
    this.page = page; // {time, round, chosen, choose(robot), seek(time)}
    this.tab = "Robot";
    this.robots = byId("robots");
    this.tabs = byId("tabs");
    this.pane = byId("pane");
    this.lines = [];
    this.plot = new Plot(run, page);
    this.journal = new Journal(run, page, () => this.draw());
    this.makeRobots();
    this.makeTabs();
  }

  makeRobots() {
    const { run, page } = this;
    if (run.count > CHIPS) {
      this.number = made("input", {
        type: "number", min: 0, max: run.count - 1, id: "robot-number",
        onchange: () => page.choose(Math.min(Math.max(Number(this.number.value) | 0, 0), run.count - 1)),
      });
      this.robots.setAttribute("role", "group");
      this.robots.append(made("label", {}, "Robot", this.number, `of ${run.count}; or click on one`));
      return;
    }
    run.robots.forEach((robot, k) => {
      const icon = made("canvas", { "aria-hidden": "true" });
      this.robots.append(made("button", {
        role: "option", title: `${robot.name}, ${robot.device}`, onclick: () => page.choose(page.chosen === k ? -1 : k),
      }, icon, String(k)));
    });
    this.paintIcons();
  }

  /** The icons again, for other colours. */
  paintIcons() {
    if (this.number) return;
    this.run.robots.forEach((robot, k) => {
      const context = fitted(this.robots.children[k].querySelector("canvas"), 22, 22);
      context.clearRect(0, 0, 22, 22);
      context.translate(11, 11);
      context.rotate(-Math.PI / 4);
      drawRobot(context, robot, 9.5 / Math.max(robot.radius, robot.length / 2), colourOf(k));
    });
  }

  makeTabs() {
    const names = ["Robot", "Shared", "Plot", "Log", "Program"];
    this.tabs.replaceChildren(...names.map((name) =>
      made("button", { role: "tab", id: `tab-${name}`, onclick: () => this.show(name) }, name)));
    this.show(this.tab);
  }

  show(name) {
    this.tab = name;
    for (const button of this.tabs.children) {
      button.setAttribute("aria-selected", String(button.textContent === name));
    }
    this.pane.setAttribute("aria-labelledby", `tab-${name}`);
    this.pane.scrollTop = 0;
    this.code = null;
    this.draw();
  }

  draw() {
    const { chosen } = this.page;
    if (this.number) {
      if (document.activeElement !== this.number) this.number.value = chosen < 0 ? "" : chosen;
    } else {
      [...this.robots.children].forEach((button, k) => button.setAttribute("aria-selected", String(k === chosen)));
    }
    if (this.tab === "Program") {
      this.drawProgram();
      return;
    }
    if (this.tab === "Plot") {
      if (this.pane.firstChild !== this.plot.element) this.pane.replaceChildren(this.plot.element);
      this.plot.draw();
      return;
    }
    if (this.tab === "Log") {
      this.journal.draw(this.pane);
      return;
    }
    const scrolled = this.pane.scrollTop;
    const content = { Robot: () => this.robot(), Shared: () => this.sharedValues() }[this.tab]();
    this.pane.replaceChildren(...content);
    this.pane.scrollTop = scrolled;
  }

  robot() {
    const { run, page } = this, { chosen: robot, time, round } = page;
    if (robot < 0) {
      return [made("p", { class: "quiet" }, "Choose a robot: here, in the world, or with [ and ].")];
    }
    const about = run.robots[robot], deed = deedOf(run, robot, round);
    const at = run.posesAt(time, this.poses ??= new Float32Array(4 * run.count)).subarray(4 * robot, 4 * robot + 4);
    const badge = made("span", { class: `badge ${deed.kind}` }, deed.words);
    if (deed.kind === "event") badge.style.background = theme(EVENT_COLOURS[deed.look % EVENT_COLOURS.length]);
    const last = run.lastEvent(robot, round);
    const facts = [
      ["this round", badge],
      ["last event", last < 0 ? "none yet" : `${run.events(robot)[run.deed(robot, last)]} at ${clock(run.roundTimes[last])}`],
      ["place", `x ${at[0].toFixed(2)}  y ${at[1].toFixed(2)}` + (about.flies ? `  height ${at[2].toFixed(2)} m` : " m")],
      ["speed", `${run.speedOf(robot, time).toFixed(2)} m/s, heading ${Math.round((turned(at[3]) * 180) / Math.PI)}°`],
    ];
    if (GLYPHS[about.look]?.tilts) {
      const [roll, pitch] = run.tiltOf(robot, time).map((angle) => Math.round((angle * 180) / Math.PI));
      facts.push(["tilt", `roll ${roll}°  pitch ${pitch}°`]);
    }
    const task = run.tasksAt(time).findIndex((one) => one.state === ASSIGNED && one.robot === robot);
    if (task >= 0) facts.push(["on its way to", `task ${task}`]);
    const kind = run.header.agents[about.agent].name;
    const content = [
      made("h2", {}, `Robot ${robot}`, made("small", {}, [about.device, kind].join(" · "))),
      made("dl", { class: "grid" }, ...facts.flatMap(([name, value]) => [made("dt", {}, name), made("dd", {}, value)])),
    ];
    const variables = run.ownAt(robot, time);
    for (const [home, title] of [["local", "Local"], ["sensor", "Sensors"], ["actuator", "Actuators"]]) {
      const of = variables.filter(([variable]) => variable.home === home);
      if (of.length) content.push(made("h3", {}, title), this.values(of));
    }
    const entries = run.sharedAt(time)
      .filter(([variable]) => variable.home === "allread");
    if (entries.length) content.push(made("h3", {}, "Its entries of allread variables"), this.entries(entries, robot));
    return content;
  }

  values(variables) {
    const { round } = this.page, list = made("dl", { class: "grid values" });
    for (const [variable, history] of variables) {
      const value = history.at(round), changed = history.changedIn(round);
      list.append(made("dt", { title: typeOf(variable.shape) }, variable.name));
      const element = elementOf(variable.shape);
      if (element?.record && !isPlace(element) && Array.isArray(value) && value.length) {
        list.append(made("dd", {}, `${value.length} ${element.record}s`));
        list.append(made("dd", { class: "below" }, this.table(element, value, changed)));
      } else {
        list.append(made("dd", { class: changed ? "changed" : null, title: typeOf(variable.shape) }, valueOf(variable.shape, value)));
      }
    }
    return list;
  }

  entries(variables, robot) {
    const { round } = this.page, list = made("dl", { class: "grid values" });
    for (const [variable, history] of variables) {
      const value = history.at(round), changed = history.changedIn(round);
      const isNew = changed && (changed.has(robot) || changed.has(WHOLE));
      list.append(made("dt", {}, variable.name));
      list.append(made("dd", { class: isNew ? "changed" : null }, valueOf(elementOf(variable.shape), value?.[robot])));
    }
    return list;
  }

  /** A list of records as a table. */
  table(record, items, changed) {
    const head = made("tr", {}, made("th", {}, "#"), ...record.fields.map(([name]) => made("th", {}, name)));
    const rows = items.slice(0, ROWS).map((item, k) => {
      const isNew = changed && (changed.has(k) || changed.has(WHOLE));
      const cells = record.fields.map(([, shape], part) =>
        made("td", { class: isNew ? "changed" : null }, item === null ? "unset" : valueOf(shape, item[part], 40)));
      return made("tr", {}, made("td", {}, String(k)), ...cells);
    });
    const table = made("table", { class: "table" }, made("thead", {}, head), made("tbody", {}, ...rows));
    return items.length > ROWS ? made("div", {}, table, `… ${items.length - ROWS} more`) : table;
  }

  sharedValues() {
    const { run, page } = this, content = [];
    for (const [home, title] of [["allwrite", "Everybody writes"], ["allread", "Everybody reads, each writes its own"]]) {
      const of = run.sharedAt(page.time).filter(([variable]) => variable.home === home);
      if (!of.length) continue;
      content.push(made("h3", {}, title));
      if (home === "allwrite") content.push(this.values(of));
      else for (const [variable, history] of of) content.push(this.allread(variable, history, page));
    }
    return content.length ? content : [made("p", { class: "quiet" }, "The program shares no variables.")];
  }

  allread(variable, history, { round, chosen }) {
    const value = history.at(round) ?? [], changed = history.changedIn(round), shape = elementOf(variable.shape);
    const first = Math.max(0, Math.min(chosen - ROWS / 2, value.length - ROWS));
    const rows = value.slice(first, first + ROWS).map((item, k) => {
      const robot = first + k, isNew = changed && (changed.has(robot) || changed.has(WHOLE));
      return made("tr", { class: robot === chosen ? "own" : null },
        made("td", {}, String(robot)), made("td", { class: isNew ? "changed" : null }, valueOf(shape, item, 90)));
    });
    const head = made("tr", {}, made("th", {}, "robot"), made("th", {}, `${variable.name} · ${typeOf(shape)}`));
    return made("table", { class: "table" }, made("thead", {}, head), made("tbody", {}, ...rows));
  }

  /** The text of the program that runs then, with the event that the chosen robot runs. */
  drawProgram() {
    const program = this.run.programAt(this.page.time);
    if (!this.code || program !== this.shown) {
      this.shown = program;
      this.lines = program.text.split("\n");
      // Words about a broken claim end in its place: file:line:column.
      const ofProgram = this.run.violations.filter((one) => this.run.programAt(one.time) === program);
      const broken = new Set(ofProgram.map((one) => Number(/:(\d+):\d+$/.exec(one.words)?.[1])));
      this.code = made("pre", { class: "code" }, ...this.lines.map((line, k) =>
        made("span", { class: broken.has(k + 1) ? "broken" : /^\s*#/.test(line) ? "comment" : null }, line)));
      this.pane.replaceChildren(this.code);
      this.marked = "";
    }
    const { chosen, round } = this.page;
    const deed = chosen >= 0 ? this.run.deed(chosen, round) : -1;
    const event = deed >= 0 ? this.run.events(chosen)[deed] : "";
    if (event === this.marked) return;
    this.marked = event;
    let inside = false;
    this.lines.forEach((line, k) => {
      if (/^\S/.test(line) && !line.startsWith("#")) inside = Boolean(event) && line.startsWith(`${event}:`);
      const runs = inside && line.trim() !== "" && !line.startsWith("#");
      this.code.children[k].classList.toggle("runs", runs);
    });
    this.code.querySelector(".runs")?.scrollIntoView({ block: "nearest" });
  }
}
