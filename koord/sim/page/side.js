// The world from the side, below the one from above.

const SIDE_HEIGHT = 96;

/** Heights over x, in the same columns as the view from above. */
function drawSide(context, map, time, tasks, chosen) {
  const { low, high, obstacles, tasks: places } = map.run.header.world;
  const top = map.planHeight, floor = map.height - 14, roof = top + 16;
  const z = (value) => floor - ((value - low[2]) / (high[2] - low[2])) * (floor - roof);
  context.fillStyle = theme("--panel");
  context.fillRect(0, top, map.width, SIDE_HEIGHT);
  context.fillStyle = theme("--line");
  context.fillRect(0, top, map.width, 1);
  context.font = "11px system-ui, sans-serif";
  context.textAlign = "right";
  context.fillStyle = theme("--faint");
  context.strokeStyle = theme("--grid");
  context.lineWidth = 1;
  const x0 = map.x(low[0]), x1 = map.x(high[0]);
  const step = Math.max(1, Math.ceil((high[2] - low[2]) / 4));
  for (let height = low[2]; height <= high[2] + 1e-9; height += step) {
    context.fillText(`${height} m`, Math.max(x0 - 6, 34), z(height) + 4);
    context.beginPath();
    context.moveTo(x0, Math.round(z(height)) + 0.5);
    context.lineTo(x1, Math.round(z(height)) + 0.5);
    context.stroke();
  }
  context.textAlign = "left";
  context.fillText("from the side: height over x", Math.max(x0, 34), top + 12);
  for (const obstacle of obstacles) {
    const xs = obstacle.corners ? obstacle.corners.map(([x]) => x)
      : [obstacle.centre[0] - obstacle.radius, obstacle.centre[0] + obstacle.radius];
    const left = map.x(Math.min(...xs)), right = map.x(Math.max(...xs));
    context.globalAlpha = 0.45;
    context.fillStyle = theme("--wall");
    context.fillRect(left, z(obstacle.high), right - left, z(obstacle.low) - z(obstacle.high));
    context.globalAlpha = 1;
  }
  places.forEach((place, k) => drawTask(context, map.x(place[0]), z(place[2]), 4, tasks[k].state));
  const small = map.run.count > MANY, taken = [];
  for (let robot = 0; robot < map.run.count; robot++) {
    const x = map.x(map.now[4 * robot]), y = z(map.now[4 * robot + 2]);
    const half = Math.max(map.run.robots[robot].radius * map.scale * 0.6, small ? 2 : 5);
    const thick = small ? 2 : 5;
    context.fillStyle = colourOf(robot);
    if (small) {
      context.fillRect(x - half, y - thick, 2 * half, thick);
    } else {
      context.save();
      context.translate(x, y);
      context.rotate(map.run.tiltOf(robot, time)[1]);
      context.fillRect(-half, -thick, 2 * half, thick);
      context.restore();
    }
    if (robot === chosen) {
      context.strokeStyle = theme("--accent");
      context.lineWidth = 1.5;
      context.strokeRect(x - half - 3, y - thick - 3, 2 * half + 6, thick + 6);
    }
    if (!small && map.shown.labels && isFree(taken, x + half, y, 14)) {
      taken.push([x + half, y, 14]);
      context.fillStyle = theme("--ink");
      context.fillText(String(robot), x + half + 2, y);
    }
  }
}
