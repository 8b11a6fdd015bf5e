// What hands can do: keys, the mouse, fingers.

function listen(page) {
  byId("play").addEventListener("click", () => page.play());
  byId("back").addEventListener("click", () => page.step(-1));
  byId("forth").addEventListener("click", () => page.step(1));
  byId("violations").addEventListener("click", () => page.toViolation(1));
  byId("theme").addEventListener("click", () => page.switchTheme());
  byId("help").addEventListener("click", () => byId("keys").showModal());
  window.addEventListener("hashchange", () => page.fromAddress());
  document.addEventListener("keydown", (event) => pressed(page, event));
  new ResizeObserver(() => page.resize()).observe(byId("stage"));
  listenToMap(page, byId("map"));
  listenToTimeline(page, byId("timeline"));
}

function pressed(page, event) {
  if (event.ctrlKey || event.metaKey || event.altKey || byId("keys").open) return;
  if (event.target.matches("input, select")) return;
  // Who goes from button to button by keyboard presses them with space.
  if (event.key === " " && event.target.matches("button:focus-visible")) return;
  const keys = {
    " ": () => page.play(),
    ArrowLeft: () => page.step(event.shiftKey ? -10 : -1),
    ArrowRight: () => page.step(event.shiftKey ? 10 : 1),
    Home: () => page.seek(0),
    End: () => page.seek(page.run.duration),
    "+": () => page.faster(1), "=": () => page.faster(1),
    "-": () => page.faster(-1), "_": () => page.faster(-1),
    n: () => page.toViolation(1), p: () => page.toViolation(-1),
    "]": () => page.choose((page.chosen + 1) % page.run.count),
    "[": () => page.choose((Math.max(page.chosen, 0) + page.run.count - 1) % page.run.count),
    f: () => { page.map.fit(); page.redraw(); },
    d: () => page.switchTheme(),
    "?": () => byId("keys").showModal(),
  };
  const action = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!action) return;
  event.preventDefault(); // else space would press the button that was clicked last
  action();
}

function listenToMap(page, canvas) {
  let from = null, moved = 0;
  canvas.addEventListener("pointerdown", (event) => {
    from = event;
    moved = 0;
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!from) {
      point(page, canvas, event);
      return;
    }
    const dx = event.clientX - from.clientX, dy = event.clientY - from.clientY;
    moved += Math.abs(dx) + Math.abs(dy);
    if (moved < 4) return;
    canvas.classList.add("dragged");
    page.map.move(dx, dy);
    from = event;
    page.redraw();
  });
  canvas.addEventListener("pointerup", (event) => {
    canvas.classList.remove("dragged");
    if (from && moved < 4) {
      const box = canvas.getBoundingClientRect();
      const robot = page.map.robotAt(event.clientX - box.left, event.clientY - box.top);
      if (robot >= 0) page.choose(robot);
    }
    from = null;
  });
  canvas.addEventListener("pointerleave", () => { byId("tip").hidden = true; });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const box = canvas.getBoundingClientRect();
    page.map.zoom(Math.exp(-event.deltaY * 0.0015), event.clientX - box.left, event.clientY - box.top);
    page.redraw();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => { page.map.fit(); page.redraw(); });
}

/** What is under the mouse: a robot with what it does, or a task. */
function point(page, canvas, event) {
  const box = canvas.getBoundingClientRect(), tip = byId("tip");
  const x = event.clientX - box.left, y = event.clientY - box.top;
  const words = page.map.wordsAt(x, y, page.time);
  canvas.style.cursor = words && page.map.robotAt(x, y) >= 0 ? "pointer" : "";
  tip.hidden = !words;
  if (!words) return;
  tip.textContent = words;
  tip.style.bottom = "auto";
  tip.style.top = `${y > 60 ? y - 34 : y + 22}px`;
  tip.style.left = `${Math.min(Math.max(x - 60, 6), Math.max(6, box.width - tip.offsetWidth - 6))}px`;
}

function listenToTimeline(page, box) {
  const tip = byId("tip");
  let isDragging = false;
  const at = (event) => {
    const place = box.getBoundingClientRect();
    return [event.clientX - place.left, event.clientY - place.top];
  };
  box.addEventListener("pointerdown", (event) => {
    const [x, y] = at(event), robot = page.timeline.robotAt(y);
    box.setPointerCapture(event.pointerId);
    isDragging = true;
    page.play(false);
    if (robot >= 0) page.choose(robot);
    if (x >= LANE_LEFT - 8) page.seek(page.timeline.timeAt(x));
  });
  box.addEventListener("pointermove", (event) => {
    const [x, y] = at(event);
    if (isDragging) page.seek(page.timeline.timeAt(x));
    const stage = byId("stage").getBoundingClientRect();
    tip.hidden = x < LANE_LEFT;
    tip.textContent = page.timeline.wordsAt(x, y);
    tip.style.left = `${Math.min(Math.max(event.clientX - stage.left - 40, 6), stage.width - 200)}px`;
    tip.style.top = "auto";
    tip.style.bottom = "6px";
  });
  box.addEventListener("pointerup", () => { isDragging = false; });
  box.addEventListener("pointerleave", () => { tip.hidden = true; });
}
