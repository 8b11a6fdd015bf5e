// A run: what was recorded, and what it says of a time. Times are seconds, rounds count from 0 as
// they stand in the recording (the first of them is INIT, with number -1).

const SHARED = -1, WHOLE = -1;
const SKIPPED = -1, BLOCKED = -2, STOPPED = -3;
const OPEN = 0, ASSIGNED = 1, DONE = 2;

class Run {
  constructor(pack) {
    this.header = pack.header;
    this.robots = pack.header.robots;
    this.count = this.robots.length;
    this.times = new Float64Array(64); // of poses
    this.samples = 0;
    this.poses = new Float32Array(64 * 4 * this.count); // sample by sample: x, y, z, heading
    this.tilting = this.robots.flatMap((robot, k) => (GLYPHS[robot.look]?.tilts ? [k] : []));
    this.tilts = new Float32Array(64 * 2 * this.tilting.length); // roll, pitch of those that tilt
    this.separations = new Float32Array(64); // NaN: not known
    this.rounds = 0;
    this.roundTimes = new Float64Array(64);
    this.roundNumbers = new Int32Array(64);
    this.deeds = new Int16Array(64 * this.count); // round by round
    this.paths = this.robots.map(() => []); // of each robot: {time, points}
    this.shared = this.header.shared.map(() => new History());
    this.own = this.robots.map((robot) =>
      this.header.agents[robot.agent].variables.map(() => new History()));
    this.said = [];
    this.tasks = [];
    this.violations = [];
    this.counted = new Set(); // of violations, so that each is there once
    this.still = []; // robots that were seen to stand still
    this.ending = null;
    this.reloads = []; // changes of the program, and edits that were refused
    // The programs one after the other: from when on, their texts, and the variables that they have
    // ([shared, of each agent]; null: all).
    this.programs = [{ time: -Infinity, text: this.header.text, has: null }];
    this.name(this.header.text);
    this.append(pack);
  }

  /** The names of all events, and which of them an agent's are; ports are named as the text does. */
  name(text) {
    const modules = [...(text ?? "").matchAll(/^[ \t]*using[ \t]+(\w+)/gm)].map(([, module]) => module).sort((a, b) => b.length - a.length);
    for (const variable of this.header.agents.flatMap((agent) => agent.variables)) {
      const module = ["sensor", "actuator"].includes(variable.home) && modules.find((one) => variable.name.startsWith(`${one}_`));
      if (module) variable.name = `${module}.${variable.name.slice(module.length + 1)}`;
    }
    const names = [...new Set(this.header.agents.flatMap((agent) => agent.events))];
    this.eventNames = names;
    this.looks = this.header.agents.map((agent) => agent.events.map((name) => names.indexOf(name)));
  }

  append(pack) {
    for (const change of pack.reloads ?? []) this.appendReload(change);
    this.appendPoses(pack);
    this.appendRounds(pack);
    this.appendPaths(pack);
    for (const [time, task, state, robot] of pack.tasks) {
      this.tasks.push({ time: time / 1000, task, state, robot });
    }
    for (const violation of pack.violations) {
      // Of `forall i, j` both orders may be told: that is one violation.
      const key = `${violation.claim}|${violation.time}|${[...violation.robots].sort((a, b) => a - b)}`;
      if (this.counted.has(key)) continue;
      this.counted.add(key);
      this.violations.push({ ...violation, time: violation.time / 1000 });
    }
    for (const [time, robot, since, words] of pack.still) {
      this.still.push({ time: time / 1000, robot, since: since / 1000, words });
    }
    this.ending = pack.ending ?? this.ending;
  }

  /** Another program goes on: what it has besides is behind what was known. */
  appendReload({ time, round, text, words, had, has, agents, shared }) {
    this.reloads.push({ time: time / 1000, round, isRefused: text === null, words });
    while (this.shared.length < shared.length) this.shared.push(new History());
    this.own.forEach((own, robot) => {
      const { variables } = agents[this.robots[robot].agent];
      while (own.length < variables.length) own.push(new History());
    });
    Object.assign(this.header, { agents, shared });
    this.name(text ?? this.programs.at(-1).text);
    this.programs[this.programs.length - 1].has ??= had;
    if (text !== null) this.programs.push({ time: time / 1000, text, has });
  }

  /** The program that runs at a time. */
  programAt(time) {
    return this.programs.findLast((one) => one.time <= time + 1e-6);
  }

  /** The shared variables that there are at a time, each with its history. */
  sharedAt(time) {
    const numbers = this.programAt(time).has?.[0] ?? this.header.shared.keys();
    return [...numbers].map((k) => [this.header.shared[k], this.shared[k]]);
  }

  /** The same of a robot's own. */
  ownAt(robot, time) {
    const { agent } = this.robots[robot], { variables } = this.header.agents[agent];
    const numbers = this.programAt(time).has?.[1][agent] ?? variables.keys();
    return [...numbers].map((k) => [variables[k], this.own[robot][k]]);
  }

  appendPoses(pack) {
    const times = new Uint32Array(pack.plane("times").buffer);
    const apart = new Uint16Array(pack.plane("separations").buffer);
    const { step, middle, turn, tilt } = this.header;
    const n = times.length, first = this.samples, robots = this.count;
    this.samples += n;
    this.times = grown(this.times, first, this.samples);
    this.separations = grown(this.separations, first, this.samples);
    this.poses = grown(this.poses, first * 4 * robots, this.samples * 4 * robots);
    for (let k = 0; k < n; k++) {
      this.times[first + k] = times[k] / 1000;
      this.separations[first + k] = apart[k] === 0xffff ? NaN : apart[k] / 1000;
    }
    const whole = summed(summed(joined(pack.plane("poses")), n), n);
    for (let part = 0, at = 0; part < 4; part++) {
      const scale = part < 3 ? step : (2 * Math.PI) / turn;
      const origin = part < 3 ? middle[part] : 0;
      for (let robot = 0; robot < robots; robot++) {
        for (let k = 0, to = (first * robots + robot) * 4 + part; k < n; k++, to += 4 * robots) {
          this.poses[to] = origin + scale * whole[at++];
        }
      }
    }
    const width = 2 * this.tilting.length, angles = summed(joined(pack.plane("tilts")), n);
    this.tilts = grown(this.tilts, first * width, this.samples * width);
    for (let part = 0, at = 0; part < 2; part++) {
      for (let robot = 0; robot < this.tilting.length; robot++) {
        for (let k = 0, to = first * width + 2 * robot + part; k < n; k++, to += width) {
          this.tilts[to] = ((2 * Math.PI) / tilt) * angles[at++];
        }
      }
    }
  }

  appendRounds(pack) {
    const n = pack.rounds.length, first = this.rounds, robots = this.count;
    const deeds = new Int16Array(pack.plane("deeds").buffer);
    this.rounds += n;
    this.roundTimes = grown(this.roundTimes, first, this.rounds);
    this.roundNumbers = grown(this.roundNumbers, first, this.rounds);
    this.deeds = grown(this.deeds, first * robots, this.rounds * robots);
    pack.rounds.forEach(([number, time, changes], k) => {
      const round = first + k;
      this.roundTimes[round] = time / 1000;
      this.roundNumbers[round] = number;
      for (let robot = 0; robot < robots; robot++) {
        this.deeds[round * robots + robot] = deeds[robot * n + k];
      }
      for (const [robot, variable, part, value] of changes) {
        const histories = robot === SHARED ? this.shared : this.own[robot];
        histories[variable].push(round, part, value);
      }
    });
    for (const [number, robot, stream, text] of pack.said) {
      this.said.push({ time: Math.max(number, 0) * this.header.delta, robot, stream, text });
    }
  }

  appendPaths(pack) {
    const heads = new Uint32Array(pack.plane("path_heads").buffer);
    const n = heads.length / 3;
    const whole = joined(pack.plane("path_points"));
    const total = whole.length / 3;
    if (total) summed(whole, total);
    const { step, middle } = this.header;
    let at = 0;
    for (let k = 0; k < n; k++) {
      const size = heads[2 * n + k];
      const points = new Float32Array(3 * size);
      for (let p = 0; p < size; p++, at++) {
        for (let part = 0; part < 3; part++) {
          points[3 * p + part] = middle[part] + step * whole[part * total + at];
        }
      }
      this.paths[heads[n + k]].push({ time: heads[k] / 1000, points });
    }
  }

  get duration() {
    const pose = this.samples ? this.times[this.samples - 1] : 0;
    return Math.max(pose, this.rounds ? this.roundTimes[this.rounds - 1] : 0);
  }

  /** What a timeline has to have room for. */
  get span() {
    return Math.max(this.duration, this.header.delta);
  }

  /** The last round that began at a time or before. */
  roundAt(time) {
    return Math.max(lastAtMost(this.roundTimes, this.rounds, time + 1e-6), 0);
  }

  /** Where all robots are at a time: x, y, z, heading of each, into an array. */
  posesAt(time, into) {
    const width = 4 * this.count;
    if (!this.samples) return into.fill(0);
    const k = Math.max(lastAtMost(this.times, this.samples, time), 0);
    const next = Math.min(k + 1, this.samples - 1);
    const gap = this.times[next] - this.times[k];
    const share = gap > 0 ? Math.min(Math.max((time - this.times[k]) / gap, 0), 1) : 0;
    const a = k * width, b = next * width, poses = this.poses;
    for (let at = 0; at < width; at += 4) {
      for (let part = 0; part < 3; part++) {
        const from = poses[a + at + part];
        into[at + part] = from + share * (poses[b + at + part] - from);
      }
      const from = poses[a + at + 3];
      into[at + 3] = from + share * turned(poses[b + at + 3] - from);
    }
    return into;
  }

  /** Where the robots of a violation were at its time. */
  placesOf(violation) {
    const then = this.posesAt(violation.time, new Float32Array(4 * this.count));
    return violation.robots.map((robot) => [then[4 * robot], then[4 * robot + 1]]);
  }

  /** How far a robot is tilted at a time: its roll and its pitch. */
  tiltOf(robot, time) {
    const at = this.tilting.indexOf(robot);
    if (at < 0 || !this.samples) return [0, 0];
    const from = 2 * (this.sampleAt(time) * this.tilting.length + at);
    return [this.tilts[from], this.tilts[from + 1]];
  }

  sampleAt(time) {
    return Math.max(lastAtMost(this.times, this.samples, time), 0);
  }

  speedOf(robot, time) {
    const k = this.sampleAt(time), from = Math.max(k - 1, 0), to = Math.min(k + 1, this.samples - 1);
    if (to <= from) return 0;
    const a = (from * this.count + robot) * 4, b = (to * this.count + robot) * 4, p = this.poses;
    const way = Math.hypot(p[b] - p[a], p[b + 1] - p[a + 1], p[b + 2] - p[a + 2]);
    return way / (this.times[to] - this.times[from]);
  }

  deed(robot, round) {
    return this.rounds ? this.deeds[round * this.count + robot] : SKIPPED;
  }

  /** The last round up to one in which a robot ran an event; -1 if there is none. */
  lastEvent(robot, round) {
    for (let k = round; k >= 0; k--) if (this.deed(robot, k) >= 0) return k;
    return -1;
  }

  pathAt(robot, time) {
    const paths = this.paths[robot];
    let low = 0, high = paths.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (paths[middle].time <= time + 1e-6) low = middle + 1; else high = middle;
    }
    return low ? paths[low - 1].points : null;
  }

  /** How far every task is at a time: {state, robot}. */
  tasksAt(time) {
    const found = this.header.world.tasks.map(() => ({ state: OPEN, robot: -1 }));
    for (const change of this.tasks) {
      if (change.time <= time + 1e-6 && found[change.task]) found[change.task] = change;
    }
    return found;
  }

  /** What a robot's event looks like: events of other names look otherwise, whatever the kind. */
  lookOf(robot, deed) {
    return deed < 0 ? deed : this.looks[this.robots[robot].agent][deed];
  }

  events(robot) {
    return this.header.agents[this.robots[robot].agent].events;
  }
}

/** The values of one variable, round by round. Looking forward is cheap. */
class History {
  constructor() {
    this.rounds = [];
    this.parts = [];
    this.values = [];
    this.used = 0; // so many changes are in `held`
    this.held = null;
  }

  push(round, part, value) {
    this.rounds.push(round);
    this.parts.push(part);
    this.values.push(value);
  }

  at(round) {
    if (this.used && this.rounds[this.used - 1] > round) {
      this.used = 0;
      this.held = null;
    }
    const last = lastAtMost(this.rounds, this.rounds.length, round) + 1;
    let k = this.used;
    for (let whole = last - 1; whole > k; whole--) {
      if (this.parts[whole] === WHOLE) { k = whole; break; }
    }
    for (; k < last; k++) {
      const value = this.values[k];
      if (this.parts[k] === WHOLE) this.held = Array.isArray(value) ? value.slice() : value;
      else if (this.held) this.held[this.parts[k]] = value;
    }
    this.used = last;
    return this.held;
  }

  /** Which elements changed in a round: null none, otherwise a set, with WHOLE for all. */
  changedIn(round) {
    const found = new Set();
    for (let k = lastAtMost(this.rounds, this.rounds.length, round); k >= 0; k--) {
      if (this.rounds[k] !== round) break;
      found.add(this.parts[k]);
    }
    return found.size ? found : null;
  }
}

/** The position of the last number that is not more than a value; -1 if there is none. */
function lastAtMost(numbers, count, value) {
  let low = 0, high = count;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (numbers[middle] <= value) low = middle + 1; else high = middle;
  }
  return low - 1;
}

/** An angle between -π and π. */
function turned(angle) {
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}
