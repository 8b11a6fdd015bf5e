// The extension: it starts `koord lsp`, and shows verdicts in the gutter and counterexamples beside.
"use strict";

const vscode = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

const KINDS = ["holds", "bounded", "vacuous", "violated", "unknown", "stale"];

let client;
let status;
const decorations = new Map();
const verdicts = new Map();
const panels = new Map();

function settings() {
  const own = vscode.workspace.getConfiguration("koord");
  return {
    verify: {
      on: own.get("verify.on"),
      robots: own.get("verify.robots"),
      rounds: own.get("verify.rounds"),
      timeoutS: own.get("verify.timeoutS"),
      cache: own.get("verify.cache"),
    },
    inlayHints: own.get("inlayHints"),
    traceView: true,
  };
}

function activate(context) {
  status = vscode.window.createStatusBarItem(vscode.StatusBarAlignment.Left);
  status.command = "koord.verifyNow";
  context.subscriptions.push(status);
  for (const kind of KINDS) {
    const icon = vscode.Uri.joinPath(context.extensionUri, "icons", `${kind}.svg`);
    const decoration = vscode.window.createTextEditorDecorationType({
      gutterIconPath: icon,
      gutterIconSize: "contain",
    });
    decorations.set(kind, decoration);
    context.subscriptions.push(decoration);
  }
  context.subscriptions.push(
    vscode.commands.registerCommand("koord.verifyNow", () => run("koord.verify")),
    vscode.commands.registerCommand("koord.cancelNow", () => run("koord.cancelVerification")),
    vscode.commands.registerCommand("koord.openCounterexample", openCounterexample),
    vscode.commands.registerCommand("koord.restart", restart),
    vscode.window.onDidChangeVisibleTextEditors(decorate),
    vscode.window.onDidChangeActiveTextEditor(showStatus),
    vscode.workspace.onDidCloseTextDocument((closed) => verdicts.delete(closed.uri.toString())),
    vscode.workspace.onDidChangeConfiguration(configured),
  );
  return start();
}

async function start() {
  const [command, ...args] = vscode.workspace.getConfiguration("koord").get("command");
  client = new LanguageClient(
    "koord",
    "Koord",
    { command, args },
    {
      documentSelector: [{ language: "koord" }],
      initializationOptions: settings(),
    },
  );
  client.onNotification("koord/verdicts", heard);
  client.onNotification("koord/showTrace", showTrace);
  try {
    await client.start();
  } catch (error) {
    client = undefined;
    const message = `\`${[command, ...args].join(" ")}\` does not start: ${error.message}`;
    const cure = "pip install 'koord[lsp]', or say in koord.command where it is";
    vscode.window.showErrorMessage(`${message}. ${cure}`);
  }
}

async function stop() {
  const running = client;
  client = undefined;
  if (running) await running.stop();
}

async function restart() {
  await stop();
  verdicts.clear();
  decorate();
  await start();
}

async function configured(event) {
  if (event.affectsConfiguration("koord.command")) return restart();
  if (event.affectsConfiguration("koord") && client) {
    await client.sendNotification("workspace/didChangeConfiguration", {
      settings: { koord: settings() },
    });
  }
}

function run(command) {
  const editor = vscode.window.activeTextEditor;
  if (!client || !editor || editor.document.languageId !== "koord") return;
  return vscode.commands.executeCommand(command, editor.document.uri.toString());
}

// --- verdicts ------------------------------------------------------------------------------------

function heard(told) {
  verdicts.set(vscode.Uri.parse(told.uri).toString(), told);
  decorate();
  showStatus();
}

function decorate() {
  for (const editor of vscode.window.visibleTextEditors) {
    const told = verdicts.get(editor.document.uri.toString());
    for (const [kind, decoration] of decorations) {
      const marks = (told ? told.marks : []).filter(
        (mark) => (mark.stale ? "stale" : mark.kind) === kind,
      );
      editor.setDecorations(
        decoration,
        marks.map((mark) => ({
          range: new vscode.Range(mark.line, 0, mark.line, 0),
          hoverMessage: mark.story,
        })),
      );
    }
  }
}

function showStatus() {
  const editor = vscode.window.activeTextEditor;
  const told = editor && verdicts.get(editor.document.uri.toString());
  if (!told) return status.hide();
  const count = (kind) => told.marks.filter((mark) => mark.kind === kind).length;
  const words = ["violated", "unknown", "vacuous"]
    .map((kind) => [count(kind), kind])
    .filter(([number]) => number)
    .map(([number, kind]) => `${number} ${kind}`);
  const done = words.length ? words.join(", ") : `${told.marks.length} hold`;
  status.text = {
    verifying: "$(sync~spin) Koord: verifying",
    cancelled: "$(circle-slash) Koord: stopped",
    errors: "$(error) Koord: mistakes",
    stale: "$(history) Koord: not verified since",
    refused: `$(warning) Koord: ${told.reason}`,
    done: `${words.length ? "$(warning)" : "$(pass)"} Koord: ${done}`,
  }[told.state];
  status.tooltip = told.marks.map((mark) => mark.title).join("\n");
  status.show();
}

// --- counterexamples -------------------------------------------------------------------------------

async function openCounterexample() {
  const editor = vscode.window.activeTextEditor;
  const told = editor && verdicts.get(editor.document.uri.toString());
  const broken = (told ? told.marks : []).filter((mark) => mark.hasTrace && !mark.stale);
  if (!broken.length) {
    return vscode.window.showInformationMessage("No claim of this program is known to be violated.");
  }
  const chosen =
    broken.length === 1
      ? broken[0]
      : await vscode.window.showQuickPick(broken.map((mark) => ({ ...mark, label: mark.title })));
  if (!chosen) return;
  return vscode.commands.executeCommand(
    "koord.counterexample",
    editor.document.uri.toString(),
    chosen.name,
  );
}

function showTrace(trace) {
  const key = `${trace.uri} ${trace.claim}`;
  let panel = panels.get(key);
  if (!panel) {
    panel = vscode.window.createWebviewPanel(
      "koord.trace",
      trace.title,
      { viewColumn: vscode.ViewColumn.Beside, preserveFocus: true },
      { enableScripts: true, localResourceRoots: [] },
    );
    panels.set(key, panel);
    panel.onDidDispose(() => panels.delete(key));
  }
  panel.webview.html = trace.html; // a whole page, which loads nothing
  panel.reveal(undefined, true);
}

module.exports = { activate, deactivate: stop };
