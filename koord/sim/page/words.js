// Words, numbers, colours and shapes: what things are called and look like.

const HUES = ["--r0", "--r1", "--r2", "--r3", "--r4", "--r5", "--r6", "--r7"];
const EVENT_COLOURS = ["--e0", "--e1", "--e2", "--e3", "--e4", "--e5", "--e6", "--e7", "--e8", "--e9"];
// Where a bar of an event stands in its lane: so events differ without colour too.
const EVENT_BARS = [[0, 1], [0.5, 1], [0, 0.5], [0.28, 0.72], [0.7, 1], [0, 0.3]];

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16, 32, 64];

const colourOf = (robot) => theme(HUES[robot % HUES.length]);

function clock(time) {
  const minutes = Math.floor(time / 60 + 1e-9), seconds = Math.max(time - 60 * minutes, 0);
  return `${minutes}:${seconds.toFixed(1).padStart(4, "0")}`;
}

const metres = (value) => `${value.toFixed(2)} m`;

/** A type as programs write it. */
function typeOf(shape) {
  if (typeof shape === "string") return shape;
  if (shape.enum) return shape.enum;
  if (shape.record) return shape.record;
  if (shape.array) return `${typeOf(shape.array)}[${shape.size}]`;
  if (shape.robots) return `${typeOf(shape.robots)}[numAgents]`;
  if (shape.list) return `${typeOf(shape.list)}[]`;
  return `Map<${shape.map.map(typeOf).join(", ")}>`;
}

/** A value in the words of its program, at most about so many characters long. */
function valueOf(shape, value, room = 160) {
  if (value === null || value === undefined) return "unset";
  if (typeof shape === "string") return scalar(shape, value);
  if (shape.enum) return shape.members[value] ?? String(value);
  if (shape.record) {
    const parts = shape.fields.map(([name, of], k) => [name, valueOf(of, value[k], room)]);
    if (isPlace(shape)) return `(${parts.map(([, text]) => text).join(", ")})`;
    return `{${parts.map(([name, text]) => `${name} ${text}`).join(", ")}}`;
  }
  if (shape.map) {
    const [key, held] = shape.map;
    return listed(value, ([k, v]) => `${valueOf(key, k)}: ${valueOf(held, v)}`, "{", "}", room);
  }
  const element = elementOf(shape);
  return listed(value, (item) => valueOf(element, item, room), "[", "]", room);
}

function listed(items, say, open, close, room) {
  let text = open;
  for (let k = 0; k < items.length; k++) {
    if (text.length > room) return `${text}, … ${items.length - k} more${close}`;
    text += (k ? ", " : "") + say(items[k]);
  }
  return text + close;
}

function scalar(kind, value) {
  if (kind !== "float" || typeof value !== "number") return String(value);
  const short = Math.round(value * 1000) / 1000;
  return Number.isInteger(short) ? short.toFixed(1) : String(short);
}

const elementOf = (shape) => shape.array ?? shape.robots ?? shape.list ?? null;

/** Whether a record is made of numbers alone, as places are. */
function isPlace(shape) {
  return Boolean(shape.record) && shape.fields.every(([, of]) => of === "float");
}

/** What a robot did in a round, in words. */
function deedOf(run, robot, round) {
  const deed = run.deed(robot, round);
  if (deed >= 0) return { words: run.events(robot)[deed], kind: "event", deed, look: run.lookOf(robot, deed) };
  if (deed === BLOCKED) return { words: "kept out by a lock", kind: "blocked", deed };
  if (deed === STOPPED) return { words: "stopped", kind: "stopped", deed };
  return { words: "skipped", kind: "skipped", deed };
}

/** Whose a violation is, and what there is to say of it. */
function storyOf(run, violation) {
  const whose = violation.robots.length ? `robot${violation.robots.length > 1 ? "s" : ""} ${violation.robots.join(" and ")}` : "";
  const words = violation.words.replace(run.header.program, shortName(run.header.program));
  return [whose, words].filter(Boolean).join(": ");
}

/** A round as `koord verify` counts them: from 1. What is recorded last may be the end of the last one. */
function roundWords(run, round) {
  const number = run.rounds ? run.roundNumbers[round] : -1;
  if (number < 0) return "the start";
  const isEnd = run.ending !== null && round === run.rounds - 1 && number > 0 && run.roundTimes[round] >= run.duration - 1e-6;
  return isEnd ? `after round ${number}` : `round ${number + 1}`;
}

/** Since when a robot stands still, and why. */
const stillStory = (one) => `since ${clock(one.since)}: ${one.words}`;

/** What an edit of the program came to. */
function reloadStory(one) {
  if (one.isRefused) return ["edit refused", `the program before goes on. ${one.words.join("; ")}`];
  return ["program changed", one.words.length ? one.words.join("; ") : "all values are kept"];
}
