// The page of a counterexample, and what the extension contributes.
"use strict";

const assert = require("node:assert");
const fs = require("node:fs");
const path = require("node:path");
const { test } = require("node:test");
const { tracePage } = require("../trace-page");

const FOLDER = path.join(__dirname, "..");

test("texts of programs do not act in the page", () => {
  const page = tracePage({ title: "<script>x</script>", html: "<table><tr><td>1</td></tr></table>" });
  assert.ok(!page.includes("<script>x"));
  assert.match(page, /Content-Security-Policy/);
  assert.match(page, /<td>1<\/td>/);
});

test("a page that is whole stays as it is", () => {
  const html = "<!DOCTYPE html><title>run</title>";
  assert.strictEqual(tracePage({ title: "x", html }), html);
});

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
