// A variable over time: of each robot that has it, or the one that all share.

const PLOT_HEIGHT = 190;
const MOST_LINES = 40; // of more robots the chosen one and the first ones are drawn

/** What can be drawn of a shape: [name, how to get a number from a value, names of values]. */
function numbersOf(name, shape) {
  if (shape === "int" || shape === "float") return [[name, (value) => value, null]];
  if (shape === "bool") return [[name, (value) => Number(value), ["false", "true"]]];
  if (shape.enum) return [[name, (value) => value, shape.members]];
  if (!shape.record) return [];
  return shape.fields.flatMap(([field, of], k) =>
    numbersOf(`${name}.${field}`, of).map(([full, get, names]) => [full, (value) => (value === null ? null : get(value[k])), names]));
}

class Plot {
  constructor(run, page) {
    this.run = run;
    this.page = page;
    this.choices = this.all();
    // At first something that changes.
    this.chosen = Math.max(0, this.choices.findIndex((one) => one.series.some((line) => line.at || line.history.rounds.length > 1)));
    this.key = "";
    this.canvas = made("canvas", { role: "img", class: "plot" });
    this.value = made("p", { class: "quiet", "aria-live": "off" });
    this.select = made("select", { "aria-label": "What is drawn over time", onchange: () => { this.chosen = Number(this.select.value); this.key = ""; this.draw(); } },
      ...this.groups());
    this.element = made("div", {}, made("label", { class: "plotted" }, this.select), this.canvas, this.value);
    this.canvas.addEventListener("pointerdown", (event) => this.seek(event));
    this.canvas.addEventListener("pointermove", (event) => { if (event.buttons) this.seek(event); });
  }

  /** The program has changed: what it has besides can be drawn, too. */
  refill() {
    const { group, name } = this.choices[this.chosen];
    this.choices = this.all();
    this.chosen = Math.max(0, this.choices.findIndex((one) => one.group === group && one.name === name));
    this.select.replaceChildren(...this.groups());
    this.select.value = String(this.chosen);
    this.key = "";
  }

  /** Everything that has a number at a time: {group, name, names, series: [{robot, at(round)}]}. */
  all() {
    const { run } = this, found = [];
    const own = new Map();
    run.robots.forEach((robot, k) => {
      run.header.agents[robot.agent].variables.forEach((variable, v) => {
        for (const [name, get, names] of numbersOf(variable.name, variable.shape)) {
          const key = `${variable.home} ${name}`;
          if (!own.has(key)) {
            own.set(key, { group: { local: "Local", sensor: "Sensors", actuator: "Actuators" }[variable.home] ?? "Of each robot", name, names, series: [] });
          }
          own.get(key).series.push({ robot: k, history: run.own[k][v], get });
        }
      });
    });
    run.header.shared.forEach((variable, v) => {
      const history = run.shared[v], element = variable.shape.robots ?? variable.shape.array;
      if (element) {
        for (const [name, get, names] of numbersOf(`${variable.name}[…]`, element)) {
          const ofRobots = Boolean(variable.shape.robots), size = ofRobots ? run.count : variable.shape.size;
          const series = Array.from({ length: size }, (_, k) => ({ robot: ofRobots ? k : -1, element: k, history, get: (value) => (value?.[k] === undefined || value[k] === null ? null : get(value[k])) }));
          found.push({ group: "Shared", name, names, series });
        }
      } else {
        for (const [name, get, names] of numbersOf(variable.name, variable.shape)) {
          found.push({ group: "Shared", name, names, series: [{ robot: -1, history, get }] });
        }
      }
    });
    return [...found, ...own.values(), ...this.moved()];
  }

  /** What is known of vehicles, without the program. */
  moved() {
    const { run } = this, robots = run.robots.map((_, robot) => robot);
    const of = (name, at) => ({ group: "Vehicles", name, names: null, series: robots.map((robot) => ({ robot, at: (time) => at(robot, time) })) });
    const place = (part) => (robot, time) => run.poses[(run.sampleAt(time) * run.count + robot) * 4 + part];
    return [
      of("speed in m/s", (robot, time) => run.speedOf(robot, time)),
      of("x in m", place(0)), of("y in m", place(1)),
      ...(run.robots.some((robot) => robot.flies) ? [of("height in m", place(2))] : []),
    ];
  }

  groups() {
    const names = [...new Set(this.choices.map((one) => one.group))];
    return names.map((group) => {
      const box = made("optgroup", { label: group });
      this.choices.forEach((one, k) => { if (one.group === group) box.append(made("option", { value: k }, one.name)); });
      return box;
    });
  }

  /** The numbers of a line: [[time, value]], in steps for variables. */
  points(line) {
    const { run } = this, found = [];
    if (line.at) {
      const count = Math.min(run.samples, 240);
      for (let k = 0; k < count; k++) {
        const time = run.times[Math.floor((k * (run.samples - 1)) / Math.max(count - 1, 1))];
        found.push([time, line.at(time)]);
      }
      return found;
    }
    let last = null;
    for (let round = 0; round < run.rounds; round++) {
      const value = line.history.at(round);
      const number = value === null || value === undefined ? null : line.get(value);
      if (number === null || typeof number !== "number" || !Number.isFinite(number)) { last = null; continue; }
      if (last !== null && last !== number) found.push([run.roundTimes[round], last]);
      if (last !== number || round + 1 === run.rounds) found.push([run.roundTimes[round], number]);
      last = number;
    }
    return found;
  }

  lines() {
    const { series } = this.choices[this.chosen], { chosen } = this.page;
    return series.length <= MOST_LINES ? series : series.filter((one, k) => k < MOST_LINES - 1 || one.robot === chosen);
  }

  draw() {
    const choice = this.choices[this.chosen];
    const width = this.canvas.getBoundingClientRect().width || 300;
    const { run, page } = this, key = [this.chosen, width, run.rounds, run.samples, page.chosen, document.documentElement.dataset.theme].join();
    if (key !== this.key) {
      this.key = key;
      this.drawn = this.lines().map((line) => ({ line, points: this.points(line) }));
      const values = this.drawn.flatMap(({ points }) => points.map(([, value]) => value));
      this.low = values.reduce((a, b) => Math.min(a, b), Infinity);
      this.high = values.reduce((a, b) => Math.max(a, b), -Infinity);
      if (this.low > this.high) [this.low, this.high] = [0, 1];
      if (this.low === this.high) [this.low, this.high] = [this.low - 1, this.high + 1];
      this.width = width;
    }
    const pen = fitted(this.canvas, width, PLOT_HEIGHT);
    pen.clearRect(0, 0, width, PLOT_HEIGHT);
    this.axes(pen, choice);
    pen.lineJoin = "round";
    for (const chosenNow of [false, true]) {
      for (const { line, points } of this.drawn) {
        if ((line.robot === page.chosen) !== chosenNow) continue;
        pen.strokeStyle = line.robot < 0 && line.element === undefined ? theme("--accent") : colourOf(line.element ?? line.robot);
        pen.globalAlpha = chosenNow || line.robot < 0 || this.drawn.length === 1 ? 1 : 0.5;
        pen.lineWidth = chosenNow || line.robot < 0 ? 2.2 : 1.2;
        pen.beginPath();
        for (const [time, value] of points) pen.lineTo(this.x(time), this.y(value));
        pen.stroke();
      }
    }
    pen.globalAlpha = 1;
    pen.fillStyle = theme("--accent");
    pen.fillRect(this.x(page.time) - 0.75, 6, 1.5, PLOT_HEIGHT - 26);
    this.value.textContent = this.words(choice);
    this.canvas.setAttribute("aria-label", `${choice.name} over time; ${this.value.textContent}`);
  }

  axes(pen, choice) {
    pen.font = "11px system-ui, sans-serif";
    pen.fillStyle = theme("--faint");
    pen.strokeStyle = theme("--grid");
    pen.lineWidth = 1;
    pen.textAlign = "right";
    const ticks = choice.names && this.high - this.low <= 8 ? Math.round(this.high - this.low) : 4;
    for (let k = 0; k <= ticks; k++) {
      const value = this.low + (k * (this.high - this.low)) / ticks, y = Math.round(this.y(value)) + 0.5;
      const text = choice.names ? choice.names[Math.round(value)] ?? "" : tidy(value, this.high - this.low);
      pen.fillText(text, 52, y + 4, 50);
      pen.beginPath();
      pen.moveTo(56, y);
      pen.lineTo(this.width - 6, y);
      pen.stroke();
    }
    pen.textAlign = "center";
    for (let k = 0; k <= 4; k++) {
      const time = (k * this.run.span) / 4;
      pen.textAlign = k === 4 ? "right" : "center";
      pen.fillText(`${tidy(time, this.run.span)} s`, Math.min(this.x(time), this.width - 6), PLOT_HEIGHT - 4);
    }
  }

  words(choice) {
    const { page, run } = this, at = (line) => (line.at ? line.at(page.time) : line.history.at(run.roundAt(page.time)));
    if (choice.series[0]?.robot < 0 && choice.series.length > 1) return `Each line is an element of ${choice.name.split("[")[0]}.`;
    const line = choice.series.find((one) => one.robot === page.chosen) ?? (choice.series[0].robot < 0 ? choice.series[0] : null);
    if (!line) return page.chosen < 0 ? "Choose a robot to read its value." : `Robot ${page.chosen} has none.`;
    const held = at(line), number = held === null || held === undefined ? null : line.at ? held : line.get(held);
    const text = number === null ? "unset" : choice.names ? choice.names[number] : tidy(number, 1);
    return `${choice.name}${line.robot < 0 ? "" : ` of robot ${line.robot}`} at ${clock(page.time)}: ${text}`;
  }

  x(time) { return 56 + (time / this.run.span) * (this.width - 62); }
  y(value) { return PLOT_HEIGHT - 22 - ((value - this.low) / (this.high - this.low)) * (PLOT_HEIGHT - 34); }

  seek(event) {
    const box = this.canvas.getBoundingClientRect();
    this.page.play(false);
    this.page.seek(((event.clientX - box.left - 56) / (this.width - 62)) * this.run.span);
  }
}

/** A number with as many digits as its range asks for. */
function tidy(value, range) {
  const digits = range >= 100 ? 0 : range >= 10 ? 1 : range >= 1 ? 2 : 4;
  return String(Number(value.toFixed(digits)));
}
