// Small drawings: robots, tasks, violations. They differ in shape, not in colour alone.

/** A robot that points along x, about its middle, `unit` pixels long for each metre. */
function drawRobot(context, robot, unit, colour) {
  context.lineJoin = "round";
  (GLYPHS[robot.look]?.draw ?? drawDisc)(context, robot, unit, colour);
}

function drawCar(context, robot, unit, colour) {
  const l = robot.length * unit, w = robot.width * unit, x = -l / 2, y = -w / 2;
  context.fillStyle = theme("--ink");
  for (const [fx, fy] of [[-0.32, -0.5], [-0.32, 0.5], [0.3, -0.5], [0.3, 0.5]]) {
    context.fillRect(fx * l - l * 0.09, fy * w - w * 0.09, l * 0.18, w * 0.18);
  }
  context.fillStyle = colour;
  rounded(context, x, y, l, w, Math.min(l, w) * 0.25);
  context.fill();
  context.fillStyle = theme("--panel"); // the windscreen is in front
  context.beginPath();
  context.moveTo(l * 0.12, y + w * 0.16);
  context.lineTo(l * 0.3, y + w * 0.24);
  context.lineTo(l * 0.3, -y - w * 0.24);
  context.lineTo(l * 0.12, -y - w * 0.16);
  context.fill();
}

function drawDrone(context, robot, unit, colour) {
  const r = robot.radius * unit, arm = r * 0.66, rotor = r * 0.36;
  context.strokeStyle = colour;
  context.lineWidth = Math.max(1.4, r * 0.16);
  context.beginPath();
  for (const [sx, sy] of [[1, 1], [-1, -1], [1, -1], [-1, 1]]) {
    context.moveTo(0, 0);
    context.lineTo(sx * arm * 0.78, sy * arm * 0.78);
  }
  context.stroke();
  context.lineWidth = Math.max(1.2, r * 0.09);
  context.fillStyle = theme("--panel");
  for (const [sx, sy] of [[1, 1], [-1, -1], [1, -1], [-1, 1]]) {
    context.beginPath();
    context.arc(sx * arm * 0.8, sy * arm * 0.8, rotor, 0, 7);
    context.fill();
    context.stroke();
  }
  context.fillStyle = colour;
  context.beginPath();
  context.arc(0, 0, r * 0.4, 0, 7);
  context.fill();
  arrow(context, r * 0.34, r * 0.92, r * 0.26);
}

function drawDisc(context, robot, unit, colour) {
  const r = robot.radius * unit;
  context.fillStyle = colour;
  context.beginPath();
  context.arc(0, 0, r * 0.8, 0, 7);
  context.fill();
  arrow(context, r * 0.6, r * 1.15, r * 0.34);
}

function drawRover(context, robot, unit, colour) {
  const r = robot.radius * unit;
  context.fillStyle = theme("--ink");
  for (const side of [-1, 1]) context.fillRect(-r * 0.3, side * r * 0.8 - r * 0.14, r * 0.6, r * 0.28);
  context.fillStyle = colour;
  context.beginPath();
  context.arc(0, 0, r * 0.8, 0, 7);
  context.fill();
  context.fillStyle = theme("--panel"); // a nose that points forwards
  arrow(context, r * 0.15, r * 0.65, r * 0.3);
}

/** By the names of `Look`: how a robot is drawn, and whether its roll and pitch are recorded. */
const GLYPHS = { car: { draw: drawCar }, drone: { draw: drawDrone, tilts: true }, rover: { draw: drawRover } };

/** What the chosen robot stands on. */
function drawHalo(context, x, y, radius) {
  context.fillStyle = theme("--halo");
  context.beginPath();
  context.arc(x, y, radius, 0, 7);
  context.fill();
  context.strokeStyle = theme("--accent");
  context.lineWidth = 1.5;
  context.stroke();
}

function arrow(context, from, to, half) {
  context.beginPath();
  context.moveTo(to, 0);
  context.lineTo(from, half);
  context.lineTo(from, -half);
  context.fill();
}

function rounded(context, x, y, w, h, r) {
  context.beginPath();
  context.roundRect(x, y, w, h, r);
}

const TASK_COLOURS = ["--open", "--assigned", "--done"];

/** A task about a point: an empty diamond, a half-filled ring, a disc with a tick. */
function drawTask(context, x, y, size, state) {
  const colour = theme(TASK_COLOURS[state]);
  context.strokeStyle = context.fillStyle = colour;
  context.lineWidth = Math.max(1.5, size * 0.2);
  context.beginPath();
  if (state === OPEN) {
    context.moveTo(x, y - size);
    context.lineTo(x + size, y);
    context.lineTo(x, y + size);
    context.lineTo(x - size, y);
    context.closePath();
    context.save();
    context.fillStyle = theme("--arena");
    context.fill();
    context.restore();
    context.stroke();
  } else if (state === ASSIGNED) {
    context.arc(x, y, size * 0.86, 0, 2 * Math.PI);
    context.save();
    context.fillStyle = theme("--arena");
    context.fill();
    context.restore();
    context.stroke();
    context.beginPath();
    context.arc(x, y, size * 0.86, Math.PI / 2, -Math.PI / 2);
    context.fill();
  } else {
    context.arc(x, y, size * 0.95, 0, 2 * Math.PI);
    context.fill();
    context.strokeStyle = theme("--arena");
    context.lineWidth = Math.max(1.5, size * 0.26);
    context.lineCap = "round";
    context.beginPath();
    context.moveTo(x - size * 0.42, y + size * 0.04);
    context.lineTo(x - size * 0.1, y + size * 0.36);
    context.lineTo(x + size * 0.45, y - size * 0.34);
    context.stroke();
    context.lineCap = "butt";
  }
}

/** A triangle with an exclamation mark. */
function drawViolation(context, x, y, size) {
  context.fillStyle = theme("--bad");
  context.beginPath();
  context.moveTo(x, y - size);
  context.lineTo(x + size * 0.95, y + size * 0.75);
  context.lineTo(x - size * 0.95, y + size * 0.75);
  context.closePath();
  context.fill();
  context.fillStyle = theme("--panel");
  context.fillRect(x - size * 0.11, y - size * 0.4, size * 0.22, size * 0.6);
  context.fillRect(x - size * 0.11, y + size * 0.34, size * 0.22, size * 0.22);
}

/** The bar of an event, `x` to `x + w`, in a lane from `top`, `h` high. */
function drawDeed(context, deed, x, w, top, h) {
  if (deed >= 0) {
    const [from, to] = EVENT_BARS[deed % EVENT_BARS.length];
    context.fillStyle = theme(EVENT_COLOURS[deed % EVENT_COLOURS.length]);
    context.fillRect(x, top + from * h, w, (to - from) * h);
  } else if (deed === BLOCKED) {
    context.fillStyle = theme("--bad");
    const cut = Math.max(1, Math.round(h / 5));
    for (let k = 0; k < 3; k++) context.fillRect(x, top + (2 * k) * cut, w, cut);
  } else if (deed === STOPPED) {
    context.fillStyle = theme("--faint");
    context.fillRect(x, top + h / 2 - 1, w, 2);
  }
}

/** A cell of a map, as the legend has it. */
function drawCell(pen, state) {
  pen.fillStyle = theme({ unknown: "--unknown", free: "--arena", wall: "--soft" }[state]);
  pen.fillRect(3, 3, 14, 14);
  pen.strokeStyle = theme("--edge");
  pen.strokeRect(3.5, 3.5, 13, 13);
  if (state !== "unknown") return;
  pen.fillStyle = theme("--faint");
  pen.font = "10px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.fillText("?", 10, 14);
}

let hatching = null;
/** Diagonal lines, for what is solid or not known. */
function hatched(context, colour) {
  hatching ??= new Map();
  if (!hatching.has(colour)) {
    const tile = made("canvas");
    tile.width = tile.height = 12;
    const pen = tile.getContext("2d");
    pen.strokeStyle = colour;
    pen.lineWidth = 1.2;
    pen.beginPath();
    for (const k of [-12, 0, 12]) {
      pen.moveTo(k - 1, 13);
      pen.lineTo(k + 13, -1);
    }
    pen.stroke();
    hatching.set(colour, context.createPattern(tile, "repeat"));
  }
  return hatching.get(colour);
}
