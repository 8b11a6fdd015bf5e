// The worker: Python, the solvers and koord, which answer one request at a time.

import { loadPyodide } from "./pyodide/pyodide.mjs";

/** Engines tell of their progress by the thousand; people read a few a second. */
const OFTEN_MS = 80;

const say = (kind, more) => postMessage({ kind, ...more });

/** The bytes of a file that is packed; the browser unpacks it beside whatever goes on here. */
async function unpacked(path) {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error(`${path}: ${answer.status} ${answer.statusText}`);
  const stream = answer.body.pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** The files of an archive of `tar`, in its plain form. */
function* filesOf(archive) {
  const text = new TextDecoder();
  const field = (at, size) => text.decode(archive.subarray(at, at + size)).split("\0", 1)[0];
  for (let at = 0; at < archive.length && archive[at]; ) {
    const name = field(at, 100), size = parseInt(field(at + 124, 12), 8), under = field(at + 345, 155);
    yield [under ? `${under}/${name}` : name, archive.subarray(at + 512, at + 512 + size)];
    at += 512 + Math.ceil(size / 512) * 512;
  }
}

async function load() {
  say("loading", { text: "loading Python" });
  const archive = unpacked("./packages.bin");
  const python = await loadPyodide({
    indexURL: "./pyodide/",
    stdLibURL: "./python_stdlib.zip",
    _loadSnapshot: unpacked("./python.bin"), // a Python that has begun, as the page was built with it
  });
  const folders = new Set();
  for (const [name, bytes] of filesOf(await archive)) {
    const path = `/packages/${name}`, folder = path.slice(0, path.lastIndexOf("/"));
    if (!folders.has(folder)) python.FS.mkdirTree(folder);
    folders.add(folder);
    python.FS.writeFile(path, bytes, { canOwn: true });
  }
  python.runPython("import sys; sys.path.append('/packages'); sys.dont_write_bytecode = True");
  say("loading", { text: "loading koord" });
  const answering = python.pyimport("playground.answering");
  say("loading", { text: "loading the solvers" });
  answering.load_engines();
  return answering;
}

let told = 0, known = "";
function tell(text, marks) {
  if (performance.now() - told < OFTEN_MS && marks === known) return;
  told = performance.now();
  known = marks;
  say("progress", { text, marks: marks ? JSON.parse(marks) : [] });
}

const loaded = load();
loaded.then(() => say("ready"), (error) => say("failed", { text: String(error.message ?? error) }));

onmessage = async ({ data }) => {
  const { isQuiet, ...request } = data;
  try {
    const answering = await loaded;
    say("answer", { answer: JSON.parse(answering.answer(JSON.stringify(request), tell)) });
  } catch (error) {
    say("failed", { text: String(error.message ?? error).trim().split("\n").pop() });
  }
};
