// The worker: Python, the solvers and koord, which answer one request at a time.

import { loadPyodide } from "./pyodide/pyodide.mjs";

/** Engines tell of their progress by the thousand; people read a few a second. */
const OFTEN_MS = 80;

const say = (kind, more) => postMessage({ kind, ...more });

async function bytes(path) {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
  return answer.arrayBuffer();
}

async function load() {
  say("loading", { text: "loading Python" });
  const [python, packages] = await Promise.all([loadPyodide({ indexURL: "./pyodide/" }), bytes("./packages.zip")]);
  say("loading", { text: "unpacking koord and its solvers" });
  python.unpackArchive(packages, "zip", { extractDir: "/packages" });
  python.runPython("import sys; sys.path.append('/packages'); sys.dont_write_bytecode = True");
  say("loading", { text: "loading koord" });
  const answering = python.pyimport("playground.answering");
  say("loading", { text: "loading the solvers" });
  answering.load_engines();
  return answering;
}

let told = 0;
function tell(text) {
  if (performance.now() - told < OFTEN_MS) return;
  told = performance.now();
  say("progress", { text });
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
