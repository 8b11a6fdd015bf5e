// The world from above, where robots tell where they are.

const SVG = "http://www.w3.org/2000/svg";

function svg(tag, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

class Sky {
  constructor(view) {
    this.view = view;
    const { story } = view.telling, { world } = story;
    this.isUsed = Boolean(world);
    this.inside = made("div", { class: "inside" });
    this.element = made("section", { class: "panel world", "aria-label": "Where robots are" },
      made("h2", {}, "Where robots are", made("small", { class: "quiet" }, "from above, in metres; × is where a robot is told to go")), this.inside);
    if (!this.isUsed) return;
    this.rows = new Set([...world.robots, ...world.targets].filter((row) => row !== null));
    const all = story.moments.flatMap((moment) => moment.positions.filter(({ row }) => this.rows.has(row)));
    const xs = all.map(({ x }) => x), ys = all.map(({ y }) => y);
    this.isFlat = all.every(({ z }) => z === 0);
    this.isUsed = all.length > 0;
    if (!this.isUsed) return;
    const least = 2;
    const grow = (low, high) => { const room = Math.max(least - (high - low), 0) / 2 + 0.12 * Math.max(high - low, least); return [low - room, high + room]; };
    [this.left, this.right] = grow(Math.min(...xs), Math.max(...xs));
    [this.low, this.high] = grow(Math.min(...ys), Math.max(...ys));
    this.width = 420;
    this.scale = this.width / (this.right - this.left);
    this.height = Math.min(Math.max(this.scale * (this.high - this.low), 90), 340);
    const fit = this.height / (this.high - this.low);
    if (fit < this.scale) this.scale = fit;
  }

  x(x) { return this.width / 2 + this.scale * (x - (this.left + this.right) / 2); }
  y(y) { return this.height / 2 - this.scale * (y - (this.low + this.high) / 2); }

  mark() {
    if (!this.isUsed) return;
    const { telling, position } = this.view, { world } = telling.story;
    const drawing = svg("svg", { viewBox: `0 0 ${this.width} ${this.height}`, role: "img" });
    const places = telling.placesAfter(position);
    const said = [];
    this.grid(drawing);
    this.trails(drawing, position);
    world.robots.forEach((row, robot) => {
      const place = row === null ? null : places.get(row);
      if (!place) return;
      const colour = `var(--r${robot % 8})`, [x, y, z] = place;
      const target = world.targets[robot] === null ? null : places.get(world.targets[robot]);
      if (target) {
        const [a, b] = [this.x(target[0]), this.y(target[1])];
        drawing.append(svg("path", { d: `M${this.x(x)} ${this.y(y)}L${a} ${b}`, stroke: colour, "stroke-dasharray": "4 4", fill: "none", opacity: 0.6 }));
        drawing.append(svg("path", { d: `M${a - 4} ${b - 4}l8 8m0 -8l-8 8`, stroke: colour, "stroke-width": 1.8 }));
      }
      const turns = telling.moments[position].robot === robot;
      drawing.append(svg("circle", { cx: this.x(x), cy: this.y(y), r: 8, fill: colour, stroke: turns ? "var(--ink)" : "var(--panel)", "stroke-width": turns ? 2.5 : 1.5 }));
      drawing.append(svg("text", { x: this.x(x) + 10, y: this.y(y) - 6 }, `${robot}${this.isFlat ? "" : ` ↑${short(Math.round(z * 100) / 100)}`}`));
      said.push(`robot ${robot} at ${[x, y, ...(this.isFlat ? [] : [z])].map((one) => short(Math.round(one * 1000) / 1000)).join(", ")}`);
    });
    drawing.setAttribute("aria-label", said.join("; "));
    this.inside.replaceChildren(drawing);
  }

  grid(drawing) {
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 1e4, 1e5, 1e6].find((one) => one * this.scale > 42) ?? 1e7;
    for (const [low, high, isX] of [[this.left, this.right, true], [this.low, this.high, false]]) {
      for (let at = Math.ceil(low / step) * step; at <= high; at += step) {
        const on = isX ? this.x(at) : this.y(at);
        drawing.append(svg("path", { d: isX ? `M${on} 0V${this.height}` : `M0 ${on}H${this.width}`, stroke: "var(--grid)" }));
        drawing.append(svg("text", isX ? { class: "axis", x: on + 3, y: this.height - 4 } : { class: "axis", x: 3, y: on - 3 }, short(at)));
      }
    }
  }

  trails(drawing, position) {
    const { telling } = this.view, { world } = telling.story;
    world.robots.forEach((row, robot) => {
      const points = [];
      for (let k = 0; k <= position; k++) {
        for (const one of telling.moments[k].positions) if (one.row === row) points.push(`${this.x(one.x)},${this.y(one.y)}`);
      }
      if (points.length > 1) {
        drawing.append(svg("polyline", { points: points.join(" "), fill: "none", stroke: `var(--r${robot % 8})`, "stroke-width": 2, opacity: 0.35 }));
      }
    });
  }
}
