// Thousands of robots: small pictures copied into pixels, which is quicker than to draw each one.

const TURN_PIXELS = 0.8; // a crowd has few headings: its edges are at most so far from where they belong
const LARGE = 48; // pictures that reach further are drawn one by one: there is room for few of them
const STAMPED = 4; // what is thinner than so many parts of 255 is not seen

class Crowd {
  constructor(map) {
    this.map = map;
    this.scratch = made("canvas");
    this.stamps = new Map(); // by name
    this.image = null; // the pixels of a frame
    this.pixels = new Uint32Array(0);
    this.width = this.height = this.ratio = 0;
    this.sortKinds(map.run.robots);
  }

  /** Robots that look alike are of one kind. */
  sortKinds(robots) {
    const known = new Map();
    this.kinds = [];
    this.kindOf = Uint32Array.from(robots, (look, robot) => {
      const hue = robot % HUES.length;
      const key = JSON.stringify([look.device, look.look, look.radius, look.length, look.width, look.middle, hue]);
      if (!known.has(key)) {
        known.set(key, this.kinds.length);
        // How far its pictures reach, so many headings has it, its pictures; all for one scale.
        this.kinds.push({ look, hue, half: 0, unit: 0, turns: 0, turned: [], shadow: null });
      }
      return known.get(key);
    });
  }

  /** Other colours, or another scale: all pictures are made again. */
  forget() {
    this.stamps.clear();
    for (const kind of this.kinds) {
      Object.assign(kind, this.map.sizeOf(kind.look), { shadow: null, turned: [], turns: 8 });
      while (kind.turns * TURN_PIXELS < Math.PI * kind.half * this.ratio) kind.turns *= 2;
    }
  }

  /** Whether a robot's picture is too large to be copied. */
  isLarge(robot) {
    return this.kinds[this.kindOf[robot]].half > LARGE;
  }

  /** All that moves, on the ground. */
  draw(context, ground, time, chosen) {
    const { map } = this, { shown, run } = map;
    this.begin(ground);
    if (shown.trails) this.trails(time);
    this.shadows();
    if (shown.safety && run.header.safety > 0) this.safety();
    if (chosen >= 0) this.halo(chosen);
    this.robots();
    context.putImageData(this.image, 0, 0);
  }

  begin(ground) {
    const ratio = window.devicePixelRatio || 1, { map } = this;
    const height = Math.min(Math.round(map.planHeight * ratio), ground.height);
    if (!this.image || this.image.width !== ground.width || this.image.height !== height || this.ratio !== ratio) {
      this.image = new ImageData(ground.width, Math.max(height, 1));
      this.pixels = new Uint32Array(this.image.data.buffer);
      [this.width, this.height, this.ratio] = [this.image.width, this.image.height, ratio];
      this.forget(); // places in pictures are counted in pixels of the whole
    }
    this.pixels.set(ground.pixels.subarray(0, this.pixels.length));
  }

  // --- layers -----------------------------------------------------------------------------------

  /** Where robots were, line by line; those of one robot go through the same samples at all times. */
  trails(time) {
    const { map, ratio } = this, { run } = map, { poses } = run, robots = run.count;
    const last = run.sampleAt(time), first = run.sampleAt(time - TRAIL_S);
    if (last <= first) return;
    const points = Math.max(10, Math.min(40, Math.floor(20000 / robots)));
    const stride = Math.max(1, Math.ceil((last - first) / points));
    const start = Math.ceil(first / stride) * stride;
    const colours = HUES.map((name) => this.packed(theme(name)));
    const scale = map.scale * ratio, left = map.left * ratio, top = map.top * ratio;
    for (let robot = 0; robot < robots; robot++) {
      const colour = colours[robot % HUES.length];
      let x = left + scale * map.now[4 * robot], y = top - scale * map.now[4 * robot + 1];
      for (let k = start + Math.floor((last - start) / stride) * stride; k >= start; k -= stride) {
        const at = (k * robots + robot) * 4;
        const toX = left + scale * poses[at], toY = top - scale * poses[at + 1];
        this.line(x, y, toX, toY, colour, 77);
        x = toX;
        y = toY;
      }
    }
  }

  /** A robot in the air throws a shadow: the higher, the further away. */
  shadows() {
    const { map } = this, { now, run } = map, ground = run.header.world.low[2];
    for (let robot = 0; robot < run.count; robot++) {
      const kind = this.kinds[this.kindOf[robot]], up = now[4 * robot + 2] - ground;
      if (!kind.look.flies || up < 0.05) continue;
      kind.shadow ??= this.shadowOf(kind.look);
      const shift = up * map.scale * 0.09;
      this.put(kind.shadow, map.x(now[4 * robot]) + shift, map.y(now[4 * robot + 1]) + shift);
    }
  }

  shadowOf(look) {
    const radius = Math.max(look.radius * this.map.scale * 0.62, 2);
    return this.stamp(`shadow ${radius}`, radius + 1, (pen) => {
      pen.fillStyle = theme("--shadow");
      pen.arc(0, 0, radius, 0, 7);
      pen.fill();
    });
  }

  safety() {
    const { map } = this, { now } = map, near = map.tooNear();
    const radius = (map.run.header.safety / 2) * map.scale;
    const discs = [false, true].map((bad) => this.stamp(`disc ${bad}`, radius + 3, (pen) => {
      pen.strokeStyle = theme(bad ? "--bad" : "--faint");
      pen.lineWidth = bad ? 3 : 1;
      pen.globalAlpha = bad ? 1 : 0.7;
      pen.arc(0, 0, radius, 0, 7);
      pen.stroke();
    }));
    for (let robot = 0; robot < map.run.count; robot++) {
      this.put(discs[near[robot]], map.x(now[4 * robot]), map.y(now[4 * robot + 1]));
    }
  }

  halo(robot) {
    const { map } = this, radius = map.haloOf(robot);
    const disc = this.stamp(`halo ${radius}`, radius + 2, (pen) => drawHalo(pen, 0, 0, radius));
    this.put(disc, map.x(map.now[4 * robot]), map.y(map.now[4 * robot + 1]));
  }

  /** Headings are one of a few, so that no picture need be turned. */
  robots() {
    const { map } = this, { now, run } = map;
    for (let robot = 0; robot < run.count; robot++) {
      const kind = this.kinds[this.kindOf[robot]], { half, look: { middle } } = kind;
      if (half > LARGE) continue;
      const yaw = now[4 * robot + 3];
      let x = now[4 * robot], y = now[4 * robot + 1];
      if (middle) {
        x += Math.cos(yaw) * middle;
        y += Math.sin(yaw) * middle;
      }
      x = map.x(x);
      y = map.y(y);
      if (x < -half || y < -half || x > map.width + half || y > map.planHeight + half) continue;
      const turn = Math.round((yaw / (2 * Math.PI)) * kind.turns) & (kind.turns - 1);
      this.put((kind.turned[turn] ??= this.robotOf(kind, turn)), x, y);
    }
  }

  robotOf({ look, hue, half, unit, turns }, turn) {
    return this.made(half, (pen) => {
      pen.rotate((-turn / turns) * 2 * Math.PI);
      drawRobot(pen, look, unit, colourOf(hue));
    });
  }

  // --- pixels -----------------------------------------------------------------------------------

  stamp(name, half, draw) {
    if (!this.stamps.has(name)) this.stamps.set(name, this.made(half, draw));
    return this.stamps.get(name);
  }

  /** What is to be done to pixels about a point: those that are covered, and those that are mixed. */
  made(half, draw) {
    const reach = Math.ceil(half), pen = fitted(this.scratch, 2 * reach, 2 * reach, true);
    pen.clearRect(0, 0, 2 * reach, 2 * reach);
    pen.save();
    pen.translate(reach, reach);
    pen.beginPath();
    draw(pen);
    pen.restore();
    const { width: side } = this.scratch, { data } = pen.getImageData(0, 0, side, side);
    const whole = new Uint32Array(data.buffer), middle = side >> 1;
    let covered = 0, seen = 0;
    for (let k = 3; k < data.length; k += 4) {
      covered += data[k] > 255 - STAMPED;
      seen += data[k] >= STAMPED;
    }
    const found = {
      reach: side - middle,
      full: covered,
      xs: new Int16Array(seen), ys: new Int16Array(seen), at: new Int32Array(seen),
      colours: new Uint32Array(covered),
      outer: new Int32Array(seen - covered), // red and blue, and green: multiplied by their share
      inner: new Int32Array(seen - covered),
      rest: new Int32Array(seen - covered),
    };
    for (let k = 0, full = 0, soft = 0; k < whole.length; k++) {
      const alpha = data[4 * k + 3], isFull = alpha > 255 - STAMPED;
      if (alpha < STAMPED) continue;
      const n = isFull ? full : covered + soft, share = Math.round((alpha / 255) * 256);
      found.xs[n] = (k % side) - middle;
      found.ys[n] = Math.floor(k / side) - middle;
      found.at[n] = found.ys[n] * this.width + found.xs[n];
      if (isFull) {
        found.colours[full++] = whole[k] | 0xff000000;
      } else {
        found.outer[soft] = Math.imul(whole[k] & 0xff00ff, share);
        found.inner[soft] = Math.imul(whole[k] & 0xff00, share);
        found.rest[soft++] = 256 - share;
      }
    }
    return found;
  }

  /** A picture about a point, on whole pixels. */
  put(stamp, x, y) {
    const { pixels, width, height } = this, { reach, full, at } = stamp;
    const left = Math.round(x * this.ratio), top = Math.round(y * this.ratio);
    if (left < reach || top < reach || left + reach > width || top + reach > height) {
      if (left > -reach && top > -reach && left < width + reach && top < height + reach) this.cut(stamp, left, top);
      return;
    }
    const { colours, outer, inner, rest } = stamp, from = top * width + left;
    for (let k = 0; k < full; k++) pixels[from + at[k]] = colours[k];
    for (let k = full, n = 0; k < at.length; k++, n++) {
      const place = from + at[k], under = pixels[place];
      pixels[place] = mixed(under, outer[n], inner[n], rest[n]);
    }
  }

  /** The same where some of it lies outside. */
  cut({ full, xs, ys, at, colours, outer, inner, rest }, left, top) {
    const { pixels, width, height } = this, from = top * width + left;
    for (let k = 0; k < at.length; k++) {
      const x = left + xs[k], y = top + ys[k], n = k - full;
      if (x < 0 || y < 0 || x >= width || y >= height) continue;
      pixels[from + at[k]] = n < 0 ? colours[k] : mixed(pixels[from + at[k]], outer[n], inner[n], rest[n]);
    }
  }

  /** A line that is one pixel wide; of each step two pixels share it. `share` is in 256. */
  line(x, y, toX, toY, colour, share) {
    const wide = this.width - 2, high = this.height - 2;
    if (Math.max(x, toX) < 0 || Math.max(y, toY) < 0 || Math.min(x, toX) > wide || Math.min(y, toY) > high) return;
    const dx = toX - x, dy = toY - y, isFlat = Math.abs(dx) >= Math.abs(dy);
    const steps = Math.ceil(isFlat ? Math.abs(dx) : Math.abs(dy));
    if (!steps) return;
    const outer = colour & 0xff00ff, inner = colour & 0xff00, { pixels, width } = this;
    const aside = isFlat ? width : 1, stepX = dx / steps, stepY = dy / steps;
    const first = Math.max(0, Math.ceil(entry(x, stepX, wide)), Math.ceil(entry(y, stepY, high)));
    const last = Math.min(steps - 1, exit(x, stepX, wide), exit(y, stepY, high));
    for (let k = first; k <= last; k++) {
      const atX = x + k * stepX, atY = y + k * stepY;
      const between = isFlat ? atY : atX, low = Math.floor(between);
      const place = isFlat ? low * width + Math.round(atX) : Math.round(atY) * width + low;
      const far = Math.round((between - low) * share), near = share - far;
      pixels[place] = mixed(pixels[place], Math.imul(outer, near), Math.imul(inner, near), 256 - near);
      pixels[place + aside] = mixed(pixels[place + aside], Math.imul(outer, far), Math.imul(inner, far), 256 - far);
    }
  }

  /** A colour of CSS as a pixel. */
  packed(colour) {
    const name = `colour ${colour}`;
    if (!this.stamps.has(name)) {
      const pen = fitted(this.scratch, 2, 2, true);
      pen.fillStyle = colour;
      pen.fillRect(0, 0, 2, 2);
      this.stamps.set(name, new Uint32Array(pen.getImageData(0, 0, 1, 1).data.buffer)[0]);
    }
    return this.stamps.get(name);
  }
}

/** A pixel under a colour, whose parts have been multiplied by its share of 256; `rest` is 256 without it. */
function mixed(under, outer, inner, rest) {
  const even = (outer + Math.imul(under & 0xff00ff, rest)) >>> 8;
  const odd = (inner + Math.imul(under & 0xff00, rest)) >>> 8;
  return (even & 0xff00ff) | (odd & 0xff00) | 0xff000000;
}

/** After how many steps something comes within 0 and a bound, and after how many it leaves them. */
const entry = (from, step, most) => (step > 0 ? -from / step : step < 0 ? (most - from) / step : 0);
const exit = (from, step, most) => (step > 0 ? (most - from) / step : step < 0 ? -from / step : Infinity);
