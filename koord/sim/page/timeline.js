// What happened when: tasks, distances, and a lane of events for each robot.

const LANE_LEFT = 84, LANE_RIGHT = 14, MOST_LANES = 24;

class Timeline {
  constructor(run, box) {
    this.run = run;
    this.box = box;
    this.lanes = box.querySelector("#lanes");
    this.cursor = box.querySelector("#now");
    this.painted = "";
    this.resize();
  }

  /** The lanes from the top: [kind, height, robot]. */
  layout() {
    const { run } = this, found = [["axis", 20]];
    if (run.violations.length) found.push(["violations", 16]);
    if (run.header.world.tasks.length) found.push(["tasks", 18]);
    if (this.hasSeparations()) found.push(["separation", window.innerWidth <= 900 ? 20 : 32]);
    const isNarrow = window.innerWidth <= 900; // where the timeline is always in sight, it has to be low
    if (run.count <= (isNarrow ? 8 : MOST_LANES)) {
      const height = isNarrow ? 9 : run.count <= 6 ? 18 : run.count <= 12 ? 13 : 8;
      for (let robot = 0; robot < run.count; robot++) found.push(["robot", height, robot]);
    } else {
      found.push(["all", isNarrow ? 28 : 74], ["chosen", isNarrow ? 12 : 20]);
    }
    return found;
  }

  hasSeparations() {
    const { separations, samples } = this.run;
    return samples > 0 && this.run.count > 1 && !Number.isNaN(separations[samples - 1]);
  }

  resize() {
    const height = this.layout().reduce((sum, [, h]) => sum + h + 2, 8);
    this.box.style.height = `${height}px`;
    this.height = height;
    this.width = this.box.getBoundingClientRect().width;
    this.painted = "";
  }

  x(time) {
    return LANE_LEFT + (time / this.run.span) * (this.width - LANE_LEFT - LANE_RIGHT);
  }

  timeAt(x) {
    const share = (x - LANE_LEFT) / (this.width - LANE_LEFT - LANE_RIGHT);
    return Math.min(Math.max(share, 0), 1) * this.run.span;
  }

  draw(time, chosen) {
    const shade = document.documentElement.dataset.theme;
    const { run } = this;
    const key = [this.width, this.height, shade, chosen, run.rounds, run.samples, run.violations.length, run.reloads.length].join();
    if (key !== this.painted) {
      this.painted = key;
      this.paint(chosen);
    }
    const context = fitted(this.cursor, this.width, this.height);
    context.clearRect(0, 0, this.width, this.height);
    const x = this.x(time);
    context.fillStyle = theme("--accent");
    context.fillRect(x - 1, 16, 2, this.height - 20);
    context.beginPath();
    context.moveTo(x - 6, 6);
    context.lineTo(x + 6, 6);
    context.lineTo(x + 6, 13);
    context.lineTo(x, 20);
    context.lineTo(x - 6, 13);
    context.fill();
  }

  paint(chosen) {
    const pen = fitted(this.lanes, this.width, this.height);
    pen.fillStyle = theme("--panel");
    pen.fillRect(0, 0, this.width, this.height);
    let top = 4;
    this.layout().forEach(([kind, height, robot], k) => {
      if (kind !== "axis") {
        pen.fillStyle = theme(k % 2 ? "--lane" : "--lane-alt");
        pen.fillRect(LANE_LEFT, top, this.width - LANE_LEFT - LANE_RIGHT, height);
      }
      this[`paint_${kind}`](pen, top, height, robot ?? chosen, chosen);
      top += height + 2;
    });
    this.paintReloads(pen);
  }

  /** Where the program changed, or was not changed, through all lanes. */
  paintReloads(pen) {
    for (const one of this.run.reloads) {
      const x = this.x(one.time);
      pen.fillStyle = theme(one.isRefused ? "--bad" : "--accent");
      pen.globalAlpha = 0.6;
      for (let y = 18; y < this.height - 2; y += 6) pen.fillRect(x - 0.5, y, 1, 3);
      pen.globalAlpha = 1;
      pen.font = "11px system-ui, sans-serif";
      pen.textAlign = "center";
      pen.fillText("✎", x, 14);
    }
  }

  name(pen, text, top, height, strong = false) {
    pen.font = `${strong ? "600 " : ""}${Math.min(12, height + 3)}px system-ui, sans-serif`;
    pen.textAlign = "right";
    pen.fillStyle = theme(strong ? "--ink" : "--soft");
    pen.fillText(text, LANE_LEFT - 8, top + height / 2 + 4, LANE_LEFT - 12);
  }

  paint_axis(pen, top, height) {
    const steps = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600];
    const room = this.width - LANE_LEFT - LANE_RIGHT;
    const step = steps.find((one) => (one / this.run.span) * room > 64) ?? 7200;
    pen.font = "11px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.fillStyle = theme("--faint");
    for (let time = 0; time <= this.run.span + 1e-9; time += step) {
      const x = this.x(time);
      pen.textAlign = x > this.width - LANE_RIGHT - 16 ? "right" : "center";
      pen.fillText(time >= 60 ? clock(time).replace(".0", "") : `${Math.round(time * 100) / 100} s`, Math.min(x, this.width - 6), top + 12);
      pen.fillRect(this.x(time), top + height - 4, 1, 4);
    }
  }

  paint_violations(pen, top, height) {
    this.name(pen, "violated", top, height);
    for (const violation of this.run.violations) {
      const x = this.x(violation.time);
      pen.fillStyle = theme("--bad");
      pen.globalAlpha = 0.35;
      pen.fillRect(x - 0.5, top, 1, this.height);
      pen.globalAlpha = 1;
      drawViolation(pen, x, top + height / 2, 6.5);
    }
  }

  paint_tasks(pen, top, height) {
    this.name(pen, "tasks", top, height);
    for (const change of this.run.tasks) {
      drawTask(pen, this.x(change.time), top + height / 2, 4.5, change.state);
    }
  }

  /** How near the two nearest robots are; the dashed line is the safety distance. */
  paint_separation(pen, top, height) {
    const { run } = this, safety = run.header.safety;
    this.name(pen, "apart", top, safety && height > 24 ? height - 12 : height);
    const room = Math.max(1, Math.floor(this.width - LANE_LEFT - LANE_RIGHT));
    const least = new Float32Array(room + 1).fill(Infinity);
    for (let k = 0; k < run.samples; k++) {
      const column = Math.round(this.x(run.times[k]) - LANE_LEFT);
      if (run.separations[k] < least[column]) least[column] = run.separations[k];
    }
    let most = 2.5 * safety;
    for (const one of least) if (one < Infinity && !safety) most = Math.max(most, one);
    most = most || 1;
    const y = (value) => top + height - 2 - Math.min(value / most, 1) * (height - 4);
    pen.strokeStyle = theme("--soft");
    pen.lineWidth = 1.2;
    pen.beginPath();
    least.forEach((value, column) => {
      if (value < Infinity) pen.lineTo(LANE_LEFT + column, y(value));
    });
    pen.stroke();
    if (!safety) return;
    pen.strokeStyle = theme("--bad");
    pen.lineWidth = 1;
    pen.setLineDash([4, 3]);
    pen.beginPath();
    pen.moveTo(LANE_LEFT, y(safety));
    pen.lineTo(this.width - LANE_RIGHT, y(safety));
    pen.stroke();
    pen.setLineDash([]);
    pen.font = "10px system-ui, sans-serif";
    pen.textAlign = "right";
    pen.fillStyle = theme("--bad");
    if (height > 24) pen.fillText(`safe: ${safety.toFixed(2)} m`, LANE_LEFT - 8, top + height - 4);
  }

  paint_robot(pen, top, height, robot, chosen) {
    this.name(pen, height > 10 ? `robot ${robot}` : String(robot), top, height, robot === chosen);
    if (height > 10) {
      pen.fillStyle = colourOf(robot);
      pen.fillRect(2, top, 4, height);
    }
    this.paintDeeds(pen, top, height, robot);
  }

  paint_chosen(pen, top, height, robot) {
    if (robot < 0) {
      this.name(pen, "–", top, height);
      return;
    }
    this.name(pen, `robot ${robot}`, top, height, true);
    this.paintDeeds(pen, top, height, robot);
  }

  /** Bars of events; where several rounds share a column, what is rarest wins. */
  paintDeeds(pen, top, height, robot) {
    const { run } = this;
    const next = (k) => (k + 1 < run.rounds ? run.roundTimes[k + 1] : run.span);
    for (const events of [false, true]) {
      for (let k = 0; k < run.rounds;) {
        const deed = run.deed(robot, k);
        let end = k;
        while (end + 1 < run.rounds && run.deed(robot, end + 1) === deed) end++;
        if (deed !== SKIPPED && deed >= 0 === events && run.roundNumbers[end] >= 0) {
          const x = this.x(run.roundTimes[k]);
          drawDeed(pen, run.lookOf(robot, deed), x, Math.max(this.x(next(end)) - x, events ? 2 : 1), top + 1, height - 2);
        }
        k = end + 1;
      }
    }
  }

  /** Of many robots: how many ran which event, column by column. */
  paint_all(pen, top, height) {
    const { run } = this;
    this.name(pen, `${run.count} robots`, top, height);
    const room = Math.max(1, Math.floor(this.width - LANE_LEFT - LANE_RIGHT));
    const kinds = EVENT_COLOURS.length + 2; // and blocked, stopped
    const counts = new Float64Array((room + 1) * kinds), rounds = new Float64Array(room + 1);
    for (let k = 0; k < run.rounds; k++) {
      const column = Math.round(this.x(run.roundTimes[k]) - LANE_LEFT);
      rounds[column]++;
      for (let robot = 0; robot < run.count; robot++) {
        const deed = run.deed(robot, k);
        if (deed >= 0) counts[column * kinds + (run.lookOf(robot, deed) % EVENT_COLOURS.length)]++;
        else if (deed === BLOCKED) counts[column * kinds + kinds - 2]++;
        else if (deed === STOPPED) counts[column * kinds + kinds - 1]++;
      }
    }
    const colours = [...EVENT_COLOURS, "--bad", "--faint"].map(theme);
    const wide = Math.max(1, Math.ceil(room / Math.max(run.rounds, 1)));
    for (let column = 0; column <= room; column++) {
      if (!rounds[column]) continue;
      let bottom = top + height;
      for (let kind = 0; kind < kinds; kind++) {
        const share = (counts[column * kinds + kind] / (rounds[column] * run.count)) * height;
        if (!share) continue;
        pen.fillStyle = colours[kind];
        pen.fillRect(LANE_LEFT + column, bottom - share, wide, share);
        bottom -= share;
      }
    }
  }

  /** What there is at a point: words for a tip. */
  wordsAt(x, y) {
    const time = this.timeAt(x), round = this.run.roundAt(time);
    let top = 4;
    for (const [kind, height, robot] of this.layout()) {
      if (kind === "robot" && y >= top && y < top + height + 2) {
        return `${clock(time)} · robot ${robot}: ${deedOf(this.run, robot, round).words}`;
      }
      top += height + 2;
    }
    return clock(time);
  }

  robotAt(y) {
    let top = 4;
    for (const [kind, height, robot] of this.layout()) {
      if (kind === "robot" && y >= top && y < top + height + 2) return robot;
      top += height + 2;
    }
    return -1;
  }
}
