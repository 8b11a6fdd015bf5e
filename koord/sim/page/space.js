// Violations of a run in space: marks on the timeline of the viewer, and a list, both of which lead
// there. The viewer is viser's, and not ours: what is shown lies over its page, and its time is set
// through the field in which people set it.
"use strict";

const violations = JSON.parse(document.getElementById("koord-data").textContent).violations;

function made(tag, attributes, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/** What shows the time, once the viewer has the run: its slider and its field. */
function player() {
  const slider = document.querySelector("[role=slider]");
  const track = slider?.closest(".mantine-Slider-root"), bar = track?.parentElement;
  const field = bar?.querySelector("input:not([type=hidden])");
  const span = Number(slider?.getAttribute("aria-valuemax"));
  return field && span > 0 ? { slider, track, field, span } : null;
}

function seek(time) {
  const { field } = player(), before = document.activeElement;
  // React sees what is typed, and not what a script assigns.
  Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(field, String(time));
  field.dispatchEvent(new Event("input", { bubbles: true }));
  // the field takes the focus, now and with its next caret: keys would be typed into it
  for (const wait of [0, 20]) setTimeout(() => (before === document.body ? field.blur() : before.focus()), wait);
}

const now = () => Number(player().slider.getAttribute("aria-valuenow"));

/** The player's time is near one, but for rounding. */
const reached = 1e-3;

function toViolation(by) {
  const times = violations.map((one) => one.shown);
  const found = by > 0 ? times.find((time) => time > now() + reached)
    : times.findLast((time) => time < now() - reached);
  if (found !== undefined) seek(found);
}

/** Whatever leads to a violation, with the time at which it is shown. */
const leading = [];

function leads(shown, element) {
  element.addEventListener("click", () => seek(shown));
  leading.push([shown, element]);
  return element;
}

function list() {
  const count = violations.length;
  const title = `▲ ${count} violation${count > 1 ? "s" : ""} `;
  const rows = violations.map(({ time, shown, claim, story }) =>
    leads(shown, made("button", { type: "button" }, made("b", {}, `${time} s: ${claim}`), story && made("br", {}), story)));
  const keys = made("kbd", { title: "to the next one, and to the one before" }, "n p");
  return made("details", { id: "koord-violations" }, made("summary", {}, title, keys), ...rows);
}

/** A mark for each time, above the timeline. */
function marks({ span }) {
  const told = new Map();
  for (const { time, shown, claim, story } of violations) {
    const words = `${time} s: ${[claim, story].filter(Boolean).join(", ")}`;
    told.set(shown, [...(told.get(shown) ?? []), words]);
  }
  const found = [...told].map(([shown, words]) => {
    const title = words.join("\n");
    const style = `left: ${(100 * Math.min(shown, span)) / span}%`;
    return leads(shown, made("button", { type: "button", title, "aria-label": title, style }, "▲"));
  });
  return made("div", { id: "koord-marks" }, ...found);
}

function show(found) {
  const above = marks(found);
  document.body.append(above, list());
  const place = () => {
    const { left, top, width } = player().track.getBoundingClientRect();
    Object.assign(above.style, { left: `${left}px`, width: `${width}px`, top: `${top - 18}px`, height: "18px" });
  };
  const light = () => {
    for (const [shown, element] of leading) {
      element.classList.toggle("now", shown <= now() + reached && now() - shown < 1.5);
    }
  };
  place();
  new ResizeObserver(place).observe(found.track);
  window.addEventListener("resize", place);
  new MutationObserver(light).observe(found.slider, { attributeFilter: ["aria-valuenow"] });
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input, textarea")) return;
    if (event.key === "n") toViolation(1);
    if (event.key === "p") toViolation(-1);
  });
}

if (violations.length) {
  const watch = new MutationObserver(() => {
    const found = player();
    if (!found) return;
    watch.disconnect();
    show(found);
  });
  watch.observe(document, { childList: true, subtree: true, attributes: true });
}
