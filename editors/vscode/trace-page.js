// The page of a counterexample. Nothing of a program acts in it: texts are escaped, and scripts that
// are not this file's own have no nonce.
"use strict";

const { randomBytes } = require("node:crypto");

function escaped(text) {
  const signs = { "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" };
  return text.replace(/[&<>"]/g, (sign) => signs[sign]);
}

/** Whether a page is whole by itself, as those of `koord … --html` are. */
function isPage(html) {
  return /^\s*<!doctype html/i.test(html);
}

function tracePage(trace) {
  if (isPage(trace.html)) return trace.html;
  const nonce = randomBytes(16).toString("hex");
  const policy = `default-src 'none'; style-src 'unsafe-inline'; script-src 'nonce-${nonce}'`;
  return `<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="${policy}">
<title>${escaped(trace.title)}</title>
<style>
body { font: var(--vscode-font-size, 13px)/1.5 var(--vscode-font-family, sans-serif); padding: 0 1em; }
table { border-collapse: collapse; }
td, th { border-bottom: 1px solid var(--vscode-panel-border, #8884); padding: .2em .8em; text-align: left; }
tr.here { background: var(--vscode-list-activeSelectionBackground, #8883); }
button { font: inherit; }
</style>
</head>
<body>
<h1>${escaped(trace.title)}</h1>
<p>Arrow keys step through the rounds. <button id="save">Keep the trace</button></p>
${trace.html}
<script nonce="${nonce}">
const api = acquireVsCodeApi();
document.getElementById("save").onclick = () => api.postMessage({ save: true });
const rows = [...document.querySelectorAll("table tr")].filter((row) => row.querySelector("td"));
let at = rows.length - 1;
function show() {
  rows.forEach((row, number) => row.classList.toggle("here", number === at));
  if (rows[at]) rows[at].scrollIntoView({ block: "nearest" });
}
document.addEventListener("keydown", (event) => {
  const step = { ArrowDown: 1, ArrowRight: 1, ArrowUp: -1, ArrowLeft: -1 }[event.key];
  if (!step) return;
  event.preventDefault();
  at = Math.max(0, Math.min(rows.length - 1, at + step));
  show();
});
show();
</script>
</body>
</html>`;
}

module.exports = { tracePage, escaped, isPage };
