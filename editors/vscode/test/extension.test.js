// The extension with the real client and a real `koord lsp`; only VS Code itself is a stand-in.
"use strict";

const assert = require("node:assert");
const fs = require("node:fs");
const Module = require("node:module");
const os = require("node:os");
const path = require("node:path");
const { after, before, test } = require("node:test");
const editor = require("./support/vscode.js");

const { api, configuration, seen } = editor;
const FOLDER = path.join(__dirname, "..");
const PROGRAM = `allwrite:
    int x = 0
Go:
    pre: x < 3
    eff: atomic: x = x + 1
invariant Small: x <= 2
invariant Natural: x >= 0
`;
const CONFIGURATION = `agents:
    - {pid: 0, on_device: car}
devices:
    car: {bot_type: CAR, planner: RRT_CAR}
`;
const TIMEOUT_MS = 20_000;
const WITHOUT = { isCancellationRequested: false, onCancellationRequested: () => ({ dispose() {} }) };

const load = Module._load;
Module._load = (name, ...rest) => (name === "vscode" ? api : load(name, ...rest));

/** The server of this source tree, or of $KOORD. */
function server() {
  const own = path.join(FOLDER, "../../.venv/bin/koord");
  return [process.env.KOORD ?? (fs.existsSync(own) ? own : "koord"), "lsp"];
}

/** Wait until something is there: what comes is told by the server, and each message is a turn. */
async function until(found, what) {
  const end = Date.now() + TIMEOUT_MS;
  for (;;) {
    const value = await found();
    if (value) return value;
    assert.ok(Date.now() < end, `not in time: ${what}; ${seen.errors}`);
    await new Promise((resolve) => setTimeout(resolve, 20));
  }
}

const folder = fs.mkdtempSync(path.join(os.tmpdir(), "koord-vscode-"));
const manifest = JSON.parse(fs.readFileSync(path.join(FOLDER, "package.json"), "utf-8"));
const context = { subscriptions: [], extensionUri: api.Uri.file(FOLDER) };
let extension;
let program;

const marks = (kind) => seen.decorations.get(kind) ?? [];
const diagnostics = () => seen.diagnostics.get(program.uri.toString()) ?? [];
const status = () => seen.status[0];

function written(name, text) {
  const file = path.join(folder, name);
  fs.writeFileSync(file, text);
  return file;
}

before(async () => {
  for (const [name, { default: value }] of Object.entries(manifest.contributes.configuration.properties)) {
    configuration.set(name, value);
  }
  configuration.set("koord.command", server());
  program = editor.open(written("counts.krd", PROGRAM));
  extension = require(path.join(FOLDER, manifest.main));
  await extension.activate(context);
  assert.deepStrictEqual(seen.errors, []);
});

after(async () => {
  await extension.deactivate();
  for (const one of context.subscriptions) one.dispose();
  fs.rmSync(folder, { recursive: true });
});

test("verdicts stand in the gutter, above their claims and in the status bar", async () => {
  await until(() => status().shown && /violated/.test(status().text), "verdicts in the status bar");
  const lines = (kind) => marks(kind).map((mark) => mark.range.start.line);
  assert.deepStrictEqual([lines("violated"), lines("holds").includes(6)], [[5], true]);
  assert.match(marks("violated")[0].hoverMessage, /Small/);
  const lenses = await seen.providers.CodeLens.provideCodeLenses(program, WITHOUT);
  const broken = lenses.filter((lens) => lens.command.command === "koord.counterexample");
  assert.deepStrictEqual(broken.map((lens) => lens.range.start.line),
    [5]);
  assert.match(broken[0].command.title, /^✗ .*show the run$/);
});

test("a counterexample is one click away, and one panel", async () => {
  const lenses = await seen.providers.CodeLens.provideCodeLenses(program, WITHOUT);
  const { command } = lenses.find((lens) => lens.command.command === "koord.counterexample");
  await api.commands.executeCommand(command.command, ...command.arguments);
  const panel = await until(() => seen.panels[0]?.webview.html && seen.panels[0], "a panel");
  assert.match(panel.title, /: counterexample$/);
  assert.match(panel.webview.html, /^<!doctype html>/i);
  assert.doesNotMatch(panel.webview.html, /(src|href)="https?:/);
  await api.commands.executeCommand(command.command, ...command.arguments);
  assert.strictEqual(seen.panels.length, 1);
  await api.commands.executeCommand("koord.openCounterexample");
  assert.deepStrictEqual([seen.picks.length, seen.panels.length], [0, 1]); // there is one to choose from
  panel.dispose();
  await api.commands.executeCommand("koord.openCounterexample");
  await until(() => seen.panels.length === 2, "another panel instead of one that was closed");
});

test("mistakes are told as they are typed, and mended", async () => {
  editor.replace(program, "pre: x < 3", "pre: nobody");
  const found = await until(() => diagnostics().find((one) => /nobody/.test(one.message)), "a mistake");
  assert.strictEqual(found.severity, api.DiagnosticSeverity.Error);
  await until(() => /mistakes/.test(status().text), "mistakes in the status bar");
  assert.ok(marks("stale").length > 0, "verdicts on the text before are shown as old");
  editor.replace(program, "pre: nobody", "pre: x < 3");
  await until(() => !diagnostics().some((one) => /nobody/.test(one.message)), "no mistake");
  await until(() => /violated/.test(status().text) && marks("stale").length === 0, "verdicts again");
});

test("what the server answers is converted: hover, completion, definition, layout", async () => {
  const x = new api.Position(3, 9);
  const { contents } = await seen.providers.Hover.provideHover(program, x, WITHOUT);
  assert.match((contents[0] ?? contents).value, /allwrite int x = 0/);
  const target = await seen.providers.Definition.provideDefinition(program, x, WITHOUT);
  assert.strictEqual((target[0] ?? target).range.start.line, 1);
  const completion = await seen.providers.CompletionItem.provideCompletionItems(
    program, new api.Position(0, 0), WITHOUT, { triggerKind: 0 });
  assert.ok((completion.items ?? completion).length > 0);
  assert.deepStrictEqual(
    await seen.providers.DocumentFormattingEdit.provideDocumentFormattingEdits(
      program, { tabSize: 4, insertSpaces: true }, WITHOUT), []);
  const tokens = await seen.providers.DocumentSemanticTokens.provideDocumentSemanticTokens(program, WITHOUT);
  assert.ok(tokens.data.length > 0 && tokens.data.length % 5 === 0);
});

test("mistakes of configurations are told as they are typed, and YAML is not laid out", async () => {
  const yaml = editor.open(written("counts.yaml", CONFIGURATION));
  const told = () => seen.diagnostics.get(yaml.uri.toString()) ?? [];
  editor.replace(yaml, "planner:", "plannner:");
  const found = await until(() => told()[0], "a mistake of a configuration");
  assert.match(found.message, /did you mean `planner`/);
  assert.deepStrictEqual([found.range.start.line, found.range.start.character], [3, 25]);
  editor.replace(yaml, "plannner:", "planner:");
  await until(() => told().length === 0, "no mistake");
  const { contents } = await seen.providers.Hover.provideHover(yaml, new api.Position(2, 3), WITHOUT);
  assert.match((contents[0] ?? contents).value, /^`devices`: /);
  assert.strictEqual(api.languages.match(seen.selectors.DocumentFormattingEdit, yaml), 0);
  assert.strictEqual(api.languages.match(seen.selectors.DocumentFormattingEdit, program), 10);
});

test("commands verify and stop, and settings reach the server", async () => {
  configuration.set("koord.verify.on", "never");
  editor.emit("ChangeConfiguration", { affectsConfiguration: (name) => name === "koord" || name === "koord.verify.on" });
  program = editor.open(written("safe.krd", PROGRAM.replace("x <= 2", "x <= 3")));
  assert.strictEqual(status().shown, false);
  await api.commands.executeCommand("koord.verifyNow");
  await until(() => /verifying|hold/.test(status().text) && status().shown, "a verification");
  await api.commands.executeCommand("koord.cancelNow");
  await until(() => /stopped/.test(status().text), "an end of it");
});

test("a server that does not start is told, with a cure; another one is started", async () => {
  configuration.set("koord.command", [path.join(folder, "nowhere"), "lsp"]);
  editor.emit("ChangeConfiguration", { affectsConfiguration: () => true });
  const told = await until(() => seen.errors.find((one) => /does not start/.test(one)), "an error");
  assert.match(told, /nowhere lsp/);
  assert.match(told, /pip install 'koord\[lsp\]'/);
  configuration.set("koord.command", server());
  configuration.set("koord.verify.on", "change");
  await api.commands.executeCommand("koord.restart");
  await until(() => status().shown && /hold/.test(status().text), "verdicts of the new server");
  assert.deepStrictEqual(marks("violated"), []);
});
