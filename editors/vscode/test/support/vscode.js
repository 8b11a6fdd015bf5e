// A stand-in of VS Code: the part of its API that the extension and its client use. It keeps what is
// registered and shown, for tests to look at; what it does not know is an error where it is called.
"use strict";

const fs = require("node:fs");
const path = require("node:path");
const { pathToFileURL, fileURLToPath } = require("node:url");

class Disposable {
  constructor(dispose) { this.dispose = dispose ?? (() => {}); }
}

/** What is shown and registered. */
const seen = {
  decorations: new Map(), // kind of the icon: what the editor shows
  diagnostics: new Map(), // address: diagnostics
  errors: [],
  infos: [],
  panels: [],
  picks: [],
  providers: {},
  selectors: {}, // of providers
  status: [],
};

class EventEmitter {
  constructor() {
    this.listeners = new Set();
    this.event = (listener, self) => {
      const bound = self ? listener.bind(self) : listener;
      this.listeners.add(bound);
      return new Disposable(() => this.listeners.delete(bound));
    };
  }
  fire(what) { for (const listener of [...this.listeners]) listener(what); }
  dispose() { this.listeners.clear(); }
}

class Position {
  constructor(line, character) { Object.assign(this, { line, character }); }
}

class Range {
  constructor(a, b, c, d) {
    const places = typeof a === "number" ? [new Position(a, b), new Position(c, d)] : [a, b];
    [this.start, this.end] = places;
  }
}

class Uri {
  constructor(text) {
    this.text = text;
    this.scheme = text.slice(0, text.indexOf(":"));
    this.fsPath = this.scheme === "file" ? fileURLToPath(text) : "";
    this.path = this.fsPath;
  }
  toString() { return this.text; }
  static parse(text) { return new Uri(text); }
  static file(name) { return new Uri(pathToFileURL(name).href); }
  static joinPath(uri, ...parts) { return Uri.file(path.join(uri.fsPath, ...parts)); }
}

class TextDocument {
  constructor(file) {
    this.uri = Uri.file(file);
    this.fileName = file;
    this.languageId = file.endsWith(".yaml") ? "yaml" : "koord";
    this.version = 1;
    this.text = fs.readFileSync(file, "utf-8");
    this.isClosed = false;
  }
  getText() { return this.text; }
  get lineCount() { return this.text.split("\n").length; }
}

class TextEditor {
  constructor(document) { this.document = document; }
  setDecorations({ kind }, shown) { seen.decorations.set(kind, shown); }
}

class CancellationTokenSource {
  constructor() {
    const cancelled = new EventEmitter();
    this.token = { isCancellationRequested: false, onCancellationRequested: cancelled.event };
    this.cancel = () => { this.token.isCancellationRequested = true; cancelled.fire(); };
    this.dispose = () => cancelled.dispose();
  }
}

class Kind {
  constructor(value) { this.value = value; }
  append(part) { return new Kind([this.value, part].filter(Boolean).join(".")); }
}

/** A class that keeps what it is made of, by the names of its parameters. */
const record = (...names) =>
  class {
    constructor(...given) { names.forEach((name, k) => (this[name] = given[k])); }
  };

const configuration = new Map();
const emitters = {};

/** The event of a name, which tests fire. */
function event(name) {
  emitters[name] ??= new EventEmitter();
  return emitters[name].event;
}

const commands = new Map();
const registers = ["CodeLens", "CodeActions", "CompletionItem", "Definition", "DocumentFormattingEdit",
  "DocumentHighlight", "DocumentSemanticTokens", "DocumentSymbol", "FoldingRange", "Hover", "InlayHints",
  "Reference", "Rename", "SignatureHelp"];

const workspace = {
  textDocuments: [],
  notebookDocuments: [],
  workspaceFolders: undefined,
  getConfiguration: (section = "") => ({
    get: (name, otherwise) => configuration.get([section, name].filter(Boolean).join(".")) ?? otherwise,
  }),
  createFileSystemWatcher: () => new Disposable(),
};
for (const name of ["ChangeConfiguration", "ChangeTextDocument", "ChangeWorkspaceFolders", "ChangeNotebookDocument",
  "CloseTextDocument", "CloseNotebookDocument", "OpenTextDocument", "OpenNotebookDocument", "SaveTextDocument",
  "SaveNotebookDocument", "CreateFiles", "RenameFiles", "DeleteFiles"]) {
  workspace[`onDid${name}`] = event(name);
}
for (const name of ["SaveTextDocument", "CreateFiles", "RenameFiles", "DeleteFiles"]) {
  workspace[`onWill${name}`] = event(`will${name}`);
}

const channel = { append() {}, appendLine() {}, clear() {}, show() {}, hide() {}, dispose() {} };
const window = {
  activeTextEditor: undefined,
  visibleTextEditors: [],
  tabGroups: { all: [], onDidChangeTabs: event("tabs"), onDidChangeTabGroups: event("groups") },
  onDidChangeVisibleTextEditors: event("visible"),
  onDidChangeActiveTextEditor: event("active"),
  createOutputChannel: () => channel,
  createStatusBarItem() {
    const item = { text: "", tooltip: "", shown: false, show() { item.shown = true; }, hide() { item.shown = false; }, dispose() {} };
    seen.status.push(item);
    return item;
  },
  createTextEditorDecorationType: ({ gutterIconPath }) => {
    if (!fs.existsSync(gutterIconPath.fsPath)) throw new Error(`no icon ${gutterIconPath}`);
    return { kind: path.basename(gutterIconPath.fsPath, ".svg"), dispose() {} };
  },
  createWebviewPanel(type, title) {
    const closed = new EventEmitter();
    const panel = { type, title, webview: { html: "" }, reveal() {}, onDidDispose: closed.event, dispose: () => closed.fire() };
    seen.panels.push(panel);
    return panel;
  },
  showErrorMessage: async (message) => void seen.errors.push(message),
  showWarningMessage: async (message) => void seen.errors.push(message),
  showInformationMessage: async (message) => void seen.infos.push(message),
  showQuickPick: async (items) => {
    seen.picks.push(items);
    return items[0];
  },
  showTextDocument: async (document) => new TextEditor(document),
};

const languages = {
  match: (selector, document) => (selector.some?.((one) => one.language === document.languageId) ? 10 : 0),
  createDiagnosticCollection: () => ({
    set: (uri, found) => void seen.diagnostics.set(uri.toString(), found),
    delete: (uri) => void seen.diagnostics.delete(uri.toString()),
    clear: () => seen.diagnostics.clear(),
    dispose() {},
  }),
};
for (const name of registers) {
  languages[`register${name}Provider`] = (selector, provider) => {
    seen.providers[name] = provider;
    seen.selectors[name] = selector;
    return new Disposable(() => delete seen.providers[name]);
  };
}

const api = {
  CancellationError: class extends Error {},
  CancellationTokenSource,
  CodeAction: record("title", "kind"),
  CodeActionKind: { Empty: new Kind(""), QuickFix: new Kind("quickfix") },
  CodeActionTriggerKind: { Invoke: 1, Automatic: 2 },
  CallHierarchyItem: record("kind", "name"),
  CodeLens: record("range", "command"),
  CompletionItem: record("label", "kind"),
  CompletionItemKind: new Proxy({}, { get: (_, name) => name }),
  CompletionTriggerKind: { Invoke: 0, TriggerCharacter: 1, TriggerForIncompleteCompletions: 2 },
  CompletionItemTag: { Deprecated: 1 },
  CompletionList: record("items", "isIncomplete"),
  Diagnostic: record("range", "message", "severity"),
  DiagnosticRelatedInformation: record("location", "message"),
  DiagnosticSeverity: { Error: 0, Warning: 1, Information: 2, Hint: 3 },
  DiagnosticTag: { Unnecessary: 1, Deprecated: 2 },
  Disposable,
  DocumentHighlight: record("range", "kind"),
  DocumentLink: record("range", "target"),
  DocumentSymbol: record("name", "detail", "kind", "range", "selectionRange"),
  EventEmitter,
  FoldingRange: record("start", "end", "kind"),
  FoldingRangeKind: { Comment: 1, Imports: 2, Region: 3 },
  Hover: record("contents", "range"),
  InlayHint: record("position", "label", "kind"),
  Location: record("uri", "range"),
  MarkdownString: class {
    constructor(value = "") { this.value = value; }
    appendCodeblock(code) { this.value += code; return this; }
    appendMarkdown(text) { this.value += text; return this; }
  },
  ParameterInformation: record("label", "documentation"),
  Position,
  ProgressLocation: { Window: 10, Notification: 15 },
  Range,
  RelativePattern: record("base", "pattern"),
  SemanticTokens: record("data", "resultId"),
  SemanticTokensLegend: record("tokenTypes", "tokenModifiers"),
  SignatureHelp: record("signatures"),
  SignatureInformation: record("label", "documentation"),
  SnippetString: record("value"),
  StatusBarAlignment: { Left: 1, Right: 2 },
  SymbolInformation: record("name", "kind"),
  SymbolKind: new Proxy({}, { get: (_, name) => name }),
  SymbolTag: { Deprecated: 1 },
  TextEdit: record("range", "newText"),
  TypeHierarchyItem: record("kind", "name"),
  Uri,
  ViewColumn: { Beside: -2 },
  WorkspaceEdit: class {
    constructor() { this.edits = []; }
    set(uri, edits) { this.edits.push([uri, edits]); }
  },
  commands: {
    registerCommand: (name, called, self) => {
      if (commands.has(name)) throw new Error(`${name} is there already`);
      commands.set(name, self ? called.bind(self) : called);
      return new Disposable(() => commands.delete(name));
    },
    executeCommand: async (name, ...given) => {
      if (!commands.has(name)) throw new Error(`command '${name}' not found`);
      return commands.get(name)(...given);
    },
  },
  env: { language: "en", appName: "stand-in", openExternal: async () => true },
  extensions: { all: [] },
  languages,
  version: "1.82.0",
  window,
  workspace,
};

/** Everything for tests: the API, what was shown, and hands. */
module.exports = {
  api,
  configuration,
  seen,
  emit: (name, what) => emitters[name].fire(what),
  open(file) {
    const document = new TextDocument(file);
    workspace.textDocuments.push(document);
    window.activeTextEditor = new TextEditor(document);
    window.visibleTextEditors = [window.activeTextEditor];
    emitters.OpenTextDocument?.fire(document);
    emitters.active?.fire(window.activeTextEditor);
    return document;
  },
  /** Type instead of the first place of a text. */
  replace(document, old, text) {
    const at = document.text.indexOf(old);
    if (at < 0) throw new Error(`${old} is not in the document`);
    const place = (offset) => {
      const before = document.text.slice(0, offset).split("\n");
      return new Position(before.length - 1, before.at(-1).length);
    };
    const range = new Range(place(at), place(at + old.length));
    document.text = document.text.slice(0, at) + text + document.text.slice(at + old.length);
    document.version += 1;
    emitters.ChangeTextDocument.fire({ document, contentChanges: [{ range, rangeOffset: at, rangeLength: old.length, text }] });
  },
};
