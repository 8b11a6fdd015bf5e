// The world from above, and from the side where somebody flies.

const TRAIL_S = 8; // how far back trails reach
const FEW = 16; // of more robots only the chosen one's height is told
const MANY = 60; // of more robots only the chosen one is labelled
const CROWD = 200; // more robots are drawn more plainly, to be quick
const LAYERS = [
  ["trails", "Trails"], ["paths", "Paths"], ["safety", "Safety discs"], ["labels", "Labels"], ["side", "Side view"],
];

class WorldMap {
  constructor(run, canvas) {
    this.run = run;
    this.canvas = canvas;
    this.now = new Float32Array(4 * run.count);
    this.shown = { trails: true, paths: true, safety: run.header.safety > 0, labels: true, side: this.hasHeights() };
    this.scale = 1;
    this.left = 0;
    this.top = 0;
    this.isFitted = true; // until it is moved
    this.ground = new Ground(run, this);
    this.crowd = run.count > CROWD ? new Crowd(this) : null;
    this.near = new Uint8Array(run.count); // whether a robot is too near to another
    this.order = Uint32Array.from(run.robots, (_, k) => k); // of robots, from left to right
    this.sprites = new Map();
    this.spriteScale = 0;
    this.resize();
  }

  hasHeights() {
    return this.run.robots.some((robot) => robot.flies) && this.run.count <= 2000;
  }

  resize() {
    const box = this.canvas.parentElement.getBoundingClientRect();
    this.width = box.width;
    this.height = box.height;
    if (this.isFitted) this.fit();
    this.ground.key = "";
  }

  get planHeight() {
    return this.height - (this.shown.side ? SIDE_HEIGHT : 0);
  }

  fit() {
    const { low, high } = this.run.header.world;
    const w = high[0] - low[0], h = high[1] - low[1];
    const aside = 34, above = 46, below = 26; // room for what stands around
    const room = this.planHeight - above - below;
    this.scale = Math.max(Math.min((this.width - 2 * aside) / w, room / h), 1e-3);
    this.left = this.width / 2 - this.scale * (low[0] + high[0]) / 2;
    this.top = above + room / 2 + this.scale * (low[1] + high[1]) / 2;
    this.isFitted = true;
  }

  zoom(factor, x, y) {
    const { low, high } = this.run.header.world;
    const least = 0.3 * Math.min(this.width, this.height) / Math.max(high[0] - low[0], high[1] - low[1]);
    const scale = Math.min(Math.max(this.scale * factor, least), 2000);
    const by = scale / this.scale;
    this.left = x - by * (x - this.left);
    this.top = y - by * (y - this.top);
    this.scale = scale;
    this.isFitted = false;
  }

  move(dx, dy) {
    this.left += dx;
    this.top += dy;
    this.isFitted = false;
  }

  x(x) { return this.left + this.scale * x; }
  y(y) { return this.top - this.scale * y; }

  /** The robot that is drawn at a point, or -1. */
  robotAt(x, y) {
    let best = -1, least = Infinity;
    for (let robot = 0; robot < this.run.count; robot++) {
      const gap = Math.hypot(this.x(this.now[4 * robot]) - x, this.y(this.now[4 * robot + 1]) - y);
      const near = Math.max(this.run.robots[robot].radius * this.scale, 9) + 3;
      if (gap < near && gap < least) [best, least] = [robot, gap];
    }
    return best;
  }

  /** What is at a point, in words; "" if there is nothing. */
  wordsAt(x, y, time) {
    const { run } = this, robot = this.robotAt(x, y);
    if (robot >= 0) {
      const [a, b, c] = this.now.subarray(4 * robot, 4 * robot + 3), about = run.robots[robot];
      const place = `(${a.toFixed(2)}, ${b.toFixed(2)}${about.flies ? `, ${c.toFixed(2)}` : ""}) m`;
      const did = deedOf(run, robot, run.roundAt(time)).words;
      return `robot ${robot} · ${about.device} · ${did} · ${place} · ${run.speedOf(robot, time).toFixed(2)} m/s`;
    }
    const tasks = run.tasksAt(time);
    const task = run.header.world.tasks.findIndex((place) => Math.hypot(this.x(place[0]) - x, this.y(place[1]) - y) < 10);
    if (task < 0 || y > this.planHeight) return "";
    const { state, robot: who } = tasks[task];
    return `task ${task}: ${["open", `assigned to robot ${who}`, `done by robot ${who}`][state]}`;
  }

  draw(time, chosen) {
    const { run } = this;
    const context = fitted(this.canvas, this.width, this.height);
    const tasks = run.tasksAt(time);
    const round = run.roundAt(time);
    run.posesAt(time, this.now);
    this.rescale();
    if (this.crowd) this.crowd.draw(context, this.ground.read(round, tasks), time, chosen);
    else this.ground.draw(context, round, tasks);
    context.save();
    context.beginPath();
    context.rect(0, 0, this.width, this.planHeight);
    context.clip();
    if (this.shown.paths) this.drawPaths(context, time, chosen);
    if (!this.crowd) {
      if (this.shown.trails) this.drawTrails(context, time);
      this.drawShadows(context);
      if (this.shown.safety && run.header.safety > 0) this.drawSafety(context);
      if (chosen >= 0) this.drawHalo(context, chosen);
    }
    this.drawRobots(context);
    if (this.shown.labels) this.drawLabels(context, chosen);
    this.drawViolations(context, time);
    context.restore();
    if (this.shown.side) drawSide(context, this, time, tasks, chosen);
  }

  /** Pictures are made for one scale. */
  rescale() {
    const ratio = window.devicePixelRatio || 1;
    if (this.spriteScale !== this.scale * ratio) this.forget();
    this.spriteScale = this.scale * ratio;
  }

  /** All pictures of robots are made again. */
  forget() {
    this.sprites.clear();
    this.crowd?.forget();
  }

  // --- what moves -------------------------------------------------------------------------------

  drawPaths(context, time, chosen) {
    const few = this.run.count <= CROWD;
    context.lineWidth = 1.5;
    for (let robot = 0; robot < this.run.count; robot++) {
      if (!few && robot !== chosen) continue;
      const points = this.run.pathAt(robot, time);
      if (!points || points.length < 6) continue;
      const last = points.length - 3;
      const x = this.x(points[last]), y = this.y(points[last + 1]);
      context.strokeStyle = colourOf(robot);
      context.globalAlpha = robot === chosen ? 0.95 : 0.55;
      context.setLineDash([5, 4]);
      context.beginPath();
      for (let k = 0; k < points.length; k += 3) context.lineTo(this.x(points[k]), this.y(points[k + 1]));
      context.stroke();
      context.setLineDash([]);
      context.beginPath();
      context.moveTo(x - 4, y - 4);
      context.lineTo(x + 4, y + 4);
      context.moveTo(x - 4, y + 4);
      context.lineTo(x + 4, y - 4);
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  /** Trails in parts that fade; all of one colour at once, which is quick. */
  drawTrails(context, time) {
    const { run } = this, robots = run.count;
    const last = run.sampleAt(time), first = run.sampleAt(time - TRAIL_S);
    if (last <= first) return;
    const points = Math.min(40, Math.floor(6000 / robots)), parts = [0.12, 0.25, 0.45];
    const stride = Math.max(1, Math.ceil((last - first) / points));
    context.lineWidth = robots > MANY ? 1.2 : 2;
    context.lineJoin = "round";
    for (let part = 0; part < parts.length; part++) {
      const from = first + Math.floor(((last - first) * part) / parts.length);
      const to = first + Math.floor(((last - first) * (part + 1)) / parts.length);
      context.globalAlpha = parts[part];
      for (let hue = 0; hue < Math.min(HUES.length, robots); hue++) {
        context.strokeStyle = colourOf(hue);
        context.beginPath();
        for (let robot = hue; robot < robots; robot += HUES.length) {
          // Every trail goes through the same samples, whatever the time, so that none flickers.
          const start = Math.ceil(from / stride) * stride;
          let moved = false;
          for (let k = Math.min(start, to); k <= to; k += stride) {
            const at = (k * robots + robot) * 4;
            const x = this.x(run.poses[at]), y = this.y(run.poses[at + 1]);
            if (moved) context.lineTo(x, y); else context.moveTo(x, y);
            moved = true;
          }
          if (part === parts.length - 1) {
            context.lineTo(this.x(this.now[4 * robot]), this.y(this.now[4 * robot + 1]));
          } else {
            const at = (Math.ceil(to / stride) * stride * robots + robot) * 4;
            if (at < last * robots * 4) context.lineTo(this.x(run.poses[at]), this.y(run.poses[at + 1]));
          }
        }
        context.stroke();
      }
    }
    context.globalAlpha = 1;
  }

  /** A robot in the air throws a shadow: the higher, the further away. */
  drawShadows(context) {
    const ground = this.run.header.world.low[2];
    context.fillStyle = theme("--shadow");
    context.beginPath();
    for (let robot = 0; robot < this.run.count; robot++) {
      const up = this.now[4 * robot + 2] - ground;
      if (!this.run.robots[robot].flies || up < 0.05) continue;
      const r = Math.max(this.run.robots[robot].radius * this.scale * 0.62, 2);
      const shift = up * this.scale * 0.09;
      const x = this.x(this.now[4 * robot]) + shift, y = this.y(this.now[4 * robot + 1]) + shift;
      context.moveTo(x + r, y);
      context.arc(x, y, r, 0, 7);
    }
    context.fill();
  }

  /** Discs of half the safety distance: robots are too near where two would meet, heights counted. */
  drawSafety(context) {
    const half = this.run.header.safety / 2, near = this.tooNear();
    for (const bad of [0, 1]) {
      context.beginPath();
      for (let robot = 0; robot < this.run.count; robot++) {
        if (near[robot] !== bad) continue;
        const x = this.x(this.now[4 * robot]), y = this.y(this.now[4 * robot + 1]);
        context.moveTo(x + half * this.scale, y);
        context.arc(x, y, half * this.scale, 0, 7);
      }
      context.strokeStyle = theme(bad ? "--bad" : "--faint");
      context.lineWidth = bad ? 3 : 1;
      context.globalAlpha = bad ? 1 : 0.7;
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  /** For each robot: 1 if it is nearer to another than the safety distance. A sweep to the right. */
  tooNear() {
    const { now, near, order } = this, apart = this.run.header.safety, robots = this.run.count;
    near.fill(0);
    // The order is nearly that of the last frame.
    for (let k = 1; k < robots; k++) {
      const robot = order[k], x = now[4 * robot];
      let to = k;
      for (; to > 0 && now[4 * order[to - 1]] > x; to--) order[to] = order[to - 1];
      order[to] = robot;
    }
    for (let k = 0; k < robots; k++) {
      const one = order[k], a = 4 * one;
      for (let m = k + 1; m < robots; m++) {
        const b = 4 * order[m], dx = now[b] - now[a];
        if (dx >= apart) break;
        const dy = now[b + 1] - now[a + 1];
        if (dy >= apart || dy <= -apart) continue;
        const dz = now[b + 2] - now[a + 2];
        if (dx * dx + dy * dy + dz * dz < apart * apart - 1e-4) near[one] = near[order[m]] = 1;
      }
    }
    return near;
  }

  /** Robots one by one; of a crowd those that are large on the screen. */
  drawRobots(context) {
    const ratio = window.devicePixelRatio || 1, { now, run } = this;
    for (let robot = 0; robot < run.count; robot++) {
      if (this.crowd && !this.crowd.isLarge(robot)) continue;
      const { half } = this.sizeOf(run.robots[robot]), middle = run.robots[robot].middle;
      const yaw = now[4 * robot + 3], cos = Math.cos(yaw), sin = Math.sin(yaw);
      const x = this.x(now[4 * robot] + cos * middle), y = this.y(now[4 * robot + 1] + sin * middle);
      if (x < -half || y < -half || x > this.width + half || y > this.planHeight + half) continue;
      context.setTransform(cos * ratio, -sin * ratio, sin * ratio, cos * ratio, x * ratio, y * ratio);
      context.drawImage(this.spriteOf(robot), -half, -half, 2 * half, 2 * half);
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
  }

  /** The picture of a robot that points along x. */
  spriteOf(robot) {
    const look = this.run.robots[robot];
    const key = `${look.device} ${look.look} ${look.radius} ${robot % HUES.length}`;
    if (!this.sprites.has(key)) {
      const { half, unit } = this.sizeOf(look);
      this.sprites.set(key, drawnOnce(half, (pen) => drawRobot(pen, look, unit, colourOf(robot))));
    }
    return this.sprites.get(key);
  }

  /** How many pixels a robot's picture reaches from its middle, and how many a metre has in it. */
  sizeOf(look) {
    const extent = Math.max(look.radius * 1.25, look.length * 0.62);
    const unit = Math.max(this.scale, 3.2 / look.radius); // never too small to be seen
    return { half: Math.ceil(Math.min(extent * unit + 1, 400)), unit };
  }

  haloOf(robot) {
    return Math.max(this.run.robots[robot].radius * this.scale, 8) + 5;
  }

  drawHalo(context, robot) {
    drawHalo(context, this.x(this.now[4 * robot]), this.y(this.now[4 * robot + 1]), this.haloOf(robot));
  }

  drawLabels(context, chosen) {
    const { now, run } = this;
    const isSeen = (robot) => {
      const x = this.x(now[4 * robot]), y = this.y(now[4 * robot + 1]);
      return x >= 0 && y >= 0 && x <= this.width && y <= this.planHeight;
    };
    let seen = 0;
    for (let robot = 0; robot < run.count && seen <= MANY; robot++) seen += isSeen(robot);
    const all = seen <= MANY;
    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "left";
    context.lineJoin = "round";
    const taken = [], labels = [];
    // The chosen one first: of labels that would cover each other the first is drawn.
    for (let turn = -1; turn < run.count; turn++) {
      const robot = turn < 0 ? chosen : turn;
      if (robot < 0 || turn === chosen || (!all && robot !== chosen) || !isSeen(robot)) continue;
      const r = Math.max(run.robots[robot].radius * this.scale * 0.75, 6);
      const x = this.x(now[4 * robot]) + r, y = this.y(now[4 * robot + 1]) - r + 2;
      const text = String(robot), width = context.measureText(text).width;
      if (!isFree(taken, x, y, width)) continue;
      taken.push([x, y, width]);
      labels.push({ robot, text, x, y, width });
    }
    // Heights where there is room left.
    for (const label of labels) {
      if (run.robots[label.robot].flies && (run.count <= FEW || label.robot === chosen)) {
        const height = ` ↑${now[4 * label.robot + 2].toFixed(1)}`, width = context.measureText(height).width;
        if (isFree(taken, label.x + label.width + 3, label.y, width)) {
          taken.push([label.x + label.width + 3, label.y, width]);
          label.text += height;
        }
      }
      context.strokeStyle = theme("--arena");
      context.lineWidth = 3.5;
      context.strokeText(label.text, label.x, label.y);
      context.fillStyle = theme("--ink");
      context.fillText(label.text, label.x, label.y);
    }
  }

  drawViolations(context, time) {
    for (const violation of this.run.violations) {
      if (violation.time > time + 1e-6) break;
      const near = time - violation.time < 1.5;
      for (const [x, y] of this.placesOf(violation)) {
        if (near) {
          context.strokeStyle = theme("--bad");
          context.lineWidth = 2.5;
          context.beginPath();
          context.arc(x, y, 20 + 14 * (time - violation.time), 0, 7);
          context.stroke();
        }
        context.globalAlpha = near ? 1 : 0.55;
        drawViolation(context, x, y - (near ? 26 : 0), near ? 11 : 8);
        context.globalAlpha = 1;
      }
    }
  }

  /** Where to look: the place of a violation, or its robots at that time. */
  placesOf(violation) {
    violation.places ??= violation.place ? [violation.place] : this.run.placesOf(violation);
    return violation.places.map(([x, y]) => [this.x(x), this.y(y)]);
  }
}

/** A picture that reaches `half` pixels from its middle to each side. */
function drawnOnce(half, draw) {
  const picture = made("canvas");
  const pen = fitted(picture, 2 * half, 2 * half);
  pen.translate(half, half);
  draw(pen);
  return picture;
}

/** Whether a label of a width has room beside the others. */
function isFree(taken, x, y, width) {
  return taken.every(([a, b, w]) => x > a + w + 2 || a > x + width + 2 || Math.abs(y - b) > 12);
}
