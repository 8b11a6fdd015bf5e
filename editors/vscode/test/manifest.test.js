// What the extension contributes.
"use strict";

const assert = require("node:assert");
const fs = require("node:fs");
const path = require("node:path");
const { test } = require("node:test");

const FOLDER = path.join(__dirname, "..");

test("what the manifest names is there", () => {
  const manifest = JSON.parse(fs.readFileSync(path.join(FOLDER, "package.json"), "utf-8"));
  const { languages, grammars, snippets, commands } = manifest.contributes;
  const named = [languages[0].configuration, grammars[0].path, snippets[0].path, manifest.main];
  for (const file of named) assert.ok(fs.existsSync(path.join(FOLDER, file)), file);
  const extension = fs.readFileSync(path.join(FOLDER, "extension.js"), "utf-8");
  for (const { command } of commands) assert.ok(extension.includes(`"${command}"`), command);
  for (const kind of ["holds", "bounded", "vacuous", "violated", "unknown", "stale"]) {
    assert.ok(fs.existsSync(path.join(FOLDER, "icons", `${kind}.svg`)), kind);
  }
});
