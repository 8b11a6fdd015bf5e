// A story with the values that its rows have after each turn. Its form: koord/traces/story_form.py.

const EVERY = 64; // values are kept at every so many turns

class Telling {
  constructor(story) {
    this.story = story;
    this.moments = story.moments;
    this.rounds = []; // {number, turns: [position of moment]}
    this.kept = [];
    const values = story.rows.map((row) => row.start);
    this.moving = new Set(); // rows that ever change
    this.moments.forEach((moment, k) => {
      if (k % EVERY === 0) this.kept.push(values.slice());
      for (const { row, value } of moment.changes) {
        values[row] = value;
        this.moving.add(row);
      }
      const last = this.rounds[this.rounds.length - 1];
      if (last && last.number === moment.round) last.turns.push(k);
      else this.rounds.push({ number: moment.round, turns: [k] });
    });
    this.roundOf = new Map(this.rounds.map((round, k) => [round.number, k]));
  }

  /** The values of all rows after a turn. */
  valuesAfter(position) {
    const from = Math.floor(position / EVERY), values = this.kept[from].slice();
    for (let k = from * EVERY; k <= position; k++) {
      for (const { row, value } of this.moments[k].changes) values[row] = value;
    }
    return values;
  }

  /** The values before a turn: of the first one, those that it starts with. */
  valuesBefore(position) {
    return position > 0 ? this.valuesAfter(position - 1) : this.kept[0];
  }

  /** The last turn of a round. */
  endOf(round) { return round.turns[round.turns.length - 1]; }

  /** Where positions were at a turn: row -> [x, y, z]. */
  placesAfter(position) {
    const places = new Map();
    for (let k = 0; k <= position; k++) {
      for (const { row, x, y, z } of this.moments[k].positions) places.set(row, [x, y, z]);
    }
    return places;
  }

  robot(number) {
    const kind = this.story.kinds[this.story.robots[number]];
    return { number, kind, words: `robot ${number}${kind.name ? ` ${kind.name}` : ""}` };
  }

  eventOf(moment) {
    return moment.event === null ? null : this.robot(moment.robot).kind.events[moment.event];
  }

  /** What a turn did, in words and for its looks. */
  deed(position) {
    const moment = this.moments[position];
    if (["INIT", "RELOAD"].includes(moment.rule)) return { kind: "start", words: this.story.ending.kind === "step" ? "before" : "start" };
    if (moment.robot === null) return { kind: "environment", words: this.story.ending.kind === "step" ? "together" : "environment" };
    const event = this.eventOf(moment);
    if (event) return { kind: "event", words: event.name, event: moment.event };
    if (moment.blocked) return { kind: "blocked", words: `${moment.blocked}: lock taken`, short: `⊘ ${moment.blocked}` };
    return { kind: "skip", words: "skips", short: "–" };
  }

  /** A turn in a line. */
  words(position) {
    const moment = this.moments[position], deed = this.deed(position);
    const isStep = this.story.ending.kind === "step";
    if (deed.kind === "start") return isStep ? "before the step" : "the start";
    if (deed.kind === "environment") return isStep ? "all that the round changes" : "the environment's turn";
    const who = `robot ${moment.robot}`;
    if (deed.kind === "event") return `${who} runs ${deed.words}`;
    return deed.kind === "blocked" ? `${who} skips: the lock of ${moment.blocked} is taken` : `${who} skips`;
  }

  /** The track's formula after a turn, or after the last turn before that has one. */
  formulaAt(track, position) {
    let found = null;
    for (const one of track.formulas) if (one.moment <= position) found = one;
    return found;
  }
}

/** A row's name with its robot, where that is not plain. */
function nameOf(row, robot = null) {
  return row.robot === null || row.robot === robot ? row.name : `${row.name}@${row.robot}`;
}

const plural = (count, word) => `${count} ${word}${count === 1 ? "" : "s"}`;
