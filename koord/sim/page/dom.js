// Elements, canvases and colours: what every page of koord is made with.

const themed = new Map();
function theme(name) {
  if (!themed.has(name)) {
    themed.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  }
  return themed.get(name);
}

/** Light where it is dark, and dark where it is light. */
function switchTheme() {
  const { dataset } = document.documentElement;
  dataset.theme = dataset.theme === "dark" ? "light" : "dark";
  themed.clear();
}

/** As light as the system is, now and when that changes. */
function followTheme(changed = () => {}) {
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const follow = () => { document.documentElement.dataset.theme = dark.matches ? "dark" : "light"; };
  follow();
  dark.addEventListener("change", () => {
    follow();
    themed.clear();
    changed();
  });
}

const shortName = (path) => path.split(/[\\/]/).pop();

/** A new element with attributes and children. */
function made(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "class") element.className = value;
    else if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

const byId = (id) => document.getElementById(id);

/** A canvas that is as sharp as the screen; its context in units of CSS pixels. `isRead`: often. */
function fitted(canvas, width, height, isRead = false) {
  const ratio = window.devicePixelRatio || 1;
  const w = Math.max(1, Math.round(width * ratio)), h = Math.max(1, Math.round(height * ratio));
  if (canvas.width !== w || canvas.height !== h) {
    canvas.width = w;
    canvas.height = h;
  }
  const context = canvas.getContext("2d", { willReadFrequently: isRead });
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return context;
}
