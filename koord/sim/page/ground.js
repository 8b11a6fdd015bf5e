// What stands still in the world: bounds, grid, obstacles, tasks, and the map that robots draw.

class Ground {
  constructor(run, view) {
    this.run = run;
    this.view = view; // says where things are on the screen
    this.picture = made("canvas"); // drawn once for each view
    this.key = "";
    this.known = null; // its pixels, where they are wanted
  }

  draw(context, round, tasks) {
    this.refresh(round, tasks);
    context.drawImage(this.picture, 0, 0, this.view.width, this.view.height);
  }

  /** The same as pixels: {width, height, pixels}. */
  read(round, tasks) {
    if (this.refresh(round, tasks) || !this.known) {
      const { width, height } = this.picture;
      const { data } = this.picture.getContext("2d").getImageData(0, 0, width, height);
      this.known = { width, height, pixels: new Uint32Array(data.buffer) };
    }
    return this.known;
  }

  /** Paint it if it has changed; whether it has. */
  refresh(round, tasks) {
    const map = this.run.header.map;
    const cells = map ? this.run.shared[map.variable].at(round) : null;
    const known = cells ? JSON.stringify(cells) : "";
    const states = tasks.map((task) => `${task.state}${task.robot}`).join();
    const { scale, left, top, width, height, shown } = this.view;
    const place = [scale, left, top, width, height, shown.side, shown.labels, window.devicePixelRatio];
    const key = [place, states, known, document.documentElement.dataset.theme].join("|");
    if (key === this.key) return false;
    this.key = key;
    this.paint(fitted(this.picture, width, height, Boolean(this.view.crowd)), cells, tasks);
    return true;
  }

  paint(pen, cells, tasks) {
    const { low, high, obstacles, tasks: places } = this.run.header.world;
    pen.fillStyle = theme("--page");
    pen.fillRect(0, 0, this.view.width, this.view.height);
    const x0 = this.view.x(low[0]), y0 = this.view.y(high[1]);
    const w = this.view.scale * (high[0] - low[0]), h = this.view.scale * (high[1] - low[1]);
    pen.save();
    pen.beginPath();
    pen.rect(0, 0, this.view.width, this.view.planHeight);
    pen.clip();
    this.paintAround(pen);
    pen.fillStyle = theme("--arena");
    pen.fillRect(x0, y0, w, h);
    this.paintGrid(pen);
    if (cells) this.paintCells(pen, cells);
    pen.strokeStyle = theme("--edge");
    pen.lineWidth = 1.5;
    pen.strokeRect(x0, y0, w, h);
    for (const obstacle of obstacles) this.paintObstacle(pen, obstacle, Boolean(cells));
    const size = Math.min(Math.max(this.view.scale * 0.11, 5), 11);
    places.forEach(([x, y], k) => drawTask(pen, this.view.x(x), this.view.y(y), size, tasks[k].state));
    if (this.view.shown.labels && this.view.scale > 26 && places.length <= 200) this.paintLabels(pen, tasks, size);
    pen.restore();
  }

  paintLabels(pen, tasks, size) {
    pen.font = "11px system-ui, sans-serif";
    pen.textAlign = "left";
    pen.fillStyle = theme("--soft");
    for (const { text, x, y } of this.labels(pen, tasks, size)) pen.fillText(text, x, y + 4);
  }

  /** What tasks are called, beside them where there is room: to the right, or else to the left. */
  labels(pen, tasks, size) {
    const places = this.run.header.world.tasks.map(([x, y, z]) => [this.view.x(x), this.view.y(y), z]);
    const taken = places.map(([x, y]) => [x - size, y, 2 * size]), found = [];
    places.forEach(([task, y, up], k) => {
      const { state, robot } = tasks[k], name = state === ASSIGNED ? `t${k} → ${robot}` : `t${k}`;
      const isHigh = this.view.shown.side && up > 0.05 && state === OPEN;
      for (const text of isHigh ? [`${name} ↑${up.toFixed(1)}`, name] : [name]) {
        const width = pen.measureText(text).width;
        const x = [task + size + 3, task - size - 3 - width].find((left) => isFree(taken, left, y, width));
        if (x === undefined) continue;
        taken.push([x, y, width]);
        found.push({ text, x, y, width });
        break;
      }
    });
    return found;
  }

  /** How many metres lie between two lines of the grid. */
  get step() {
    let step = 1;
    while (step * this.view.scale < 28) step *= step === 2 || step === 20 || step === 200 ? 2.5 : 2;
    return step;
  }

  /** The grid goes on around the arena, so that distances can be read in all of the pane. */
  paintAround(pen) {
    const { view, step } = this, { low } = this.run.header.world;
    const first = (from, at) => at + step * view.scale * Math.ceil((from - at) / (step * view.scale));
    pen.strokeStyle = theme("--line");
    pen.globalAlpha = 0.55;
    pen.lineWidth = 1;
    pen.beginPath();
    const along = view.x(Math.ceil(low[0] / step) * step), across = view.y(Math.ceil(low[1] / step) * step);
    for (let x = first(0, along); x <= view.width; x += step * view.scale) {
      pen.moveTo(Math.round(x) + 0.5, 0);
      pen.lineTo(Math.round(x) + 0.5, view.planHeight);
    }
    for (let y = first(0, across); y <= view.planHeight; y += step * view.scale) {
      pen.moveTo(0, Math.round(y) + 0.5);
      pen.lineTo(view.width, Math.round(y) + 0.5);
    }
    pen.stroke();
    pen.globalAlpha = 1;
  }

  paintGrid(pen) {
    const { step } = this, { low, high } = this.run.header.world;
    pen.strokeStyle = theme("--grid");
    pen.fillStyle = theme("--faint");
    pen.lineWidth = 1;
    pen.font = "11px system-ui, sans-serif";
    pen.beginPath();
    const bottom = Math.min(this.view.y(low[1]) + 15, this.view.planHeight - 5);
    const left = Math.max(this.view.x(low[0]) - 6, 22);
    pen.textAlign = "center";
    for (let x = Math.ceil(low[0] / step) * step; x <= high[0] + 1e-9; x += step) {
      pen.moveTo(Math.round(this.view.x(x)) + 0.5, this.view.y(low[1]));
      pen.lineTo(Math.round(this.view.x(x)) + 0.5, this.view.y(high[1]));
      if (Math.round(x / step) % 2 === 0) pen.fillText(Math.round(x * 10) / 10, this.view.x(x), bottom);
    }
    pen.textAlign = "right";
    for (let y = Math.ceil(low[1] / step) * step; y <= high[1] + 1e-9; y += step) {
      pen.moveTo(this.view.x(low[0]), Math.round(this.view.y(y)) + 0.5);
      pen.lineTo(this.view.x(high[0]), Math.round(this.view.y(y)) + 0.5);
      if (Math.round(y / step) % 2 === 0) pen.fillText(Math.round(y * 10) / 10, left, this.view.y(y) + 4);
    }
    pen.stroke();
    pen.textAlign = "left";
    pen.fillText("m", Math.min(this.view.x(high[0]) + 8, this.view.width - 14), bottom);
  }

  paintCells(pen, cells) {
    const map = this.run.header.map, size = map.cell * this.view.scale;
    const states = cellStates(map, cells);
    for (let cell = 0; cell < states.length; cell++) {
      if (states[cell] === "free") continue;
      const unknown = states[cell] === "unknown";
      const x = this.view.x(map.origin[0] + (cell % map.columns) * map.cell);
      const y = this.view.y(map.origin[1] + (Math.floor(cell / map.columns) + 1) * map.cell);
      pen.fillStyle = unknown ? theme("--unknown") : theme("--soft");
      pen.fillRect(x, y, size + 0.5, size + 0.5);
      if (unknown) {
        pen.fillStyle = theme("--faint");
        pen.font = "10px system-ui, sans-serif";
        pen.textAlign = "center";
        if (size > 16) pen.fillText("?", x + size / 2, y + size / 2 + 4);
      }
    }
  }

  /** An obstacle; where robots draw a map only its outline, so that the map can be seen. */
  paintObstacle(pen, obstacle, isMapped) {
    pen.beginPath();
    let cx = 0, cy = 0, room = 0;
    if (obstacle.corners) {
      const points = obstacle.corners.map(([x, y]) => [this.view.x(x), this.view.y(y)]);
      points.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
      pen.closePath();
      cx = points.reduce((sum, [x]) => sum + x, 0) / points.length;
      cy = points.reduce((sum, [, y]) => sum + y, 0) / points.length;
      room = Math.max(...points.map(([x]) => x)) - Math.min(...points.map(([x]) => x));
    } else {
      [cx, cy] = [this.view.x(obstacle.centre[0]), this.view.y(obstacle.centre[1])];
      room = 2 * obstacle.radius * this.view.scale;
      pen.arc(cx, cy, room / 2, 0, 7);
    }
    pen.fillStyle = theme("--wall");
    if (!isMapped) pen.fill();
    pen.fillStyle = hatched(pen, theme("--wall-line"));
    pen.globalAlpha = 0.55;
    pen.fill();
    pen.globalAlpha = 1;
    pen.strokeStyle = theme("--wall-line");
    pen.lineWidth = 1.5;
    pen.stroke();
    const { low, high } = this.run.header.world;
    if (this.view.shown.side && room > 34 && (obstacle.high < high[2] || obstacle.low > low[2])) {
      const text = `${obstacle.low}–${obstacle.high} m`;
      pen.font = "11px system-ui, sans-serif";
      pen.textAlign = "center";
      pen.lineWidth = 3;
      pen.strokeStyle = theme("--wall");
      pen.strokeText(text, cx, cy + 4);
      pen.fillStyle = theme("--ink");
      pen.fillText(text, cx, cy + 4);
    }
  }
}

/** What a map says of each cell: "unknown", "free" or "wall". */
function cellStates(map, cells) {
  const of = map.free === undefined ? new Map(cells ?? []) : null;
  return Array.from({ length: map.columns * map.rows }, (_, cell) => {
    const value = of ? of.get(cell) : cells?.[cell];
    if (of ? value === undefined : value === map.unknown || value === null || value === undefined) return "unknown";
    return (of ? value === false : value === map.free) ? "free" : "wall";
  });
}
