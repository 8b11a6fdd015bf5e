// The grammar as VS Code reads it: vscode-textmate with oniguruma.
"use strict";

const assert = require("node:assert");
const fs = require("node:fs");
const path = require("node:path");
const { before, test } = require("node:test");
const oniguruma = require("vscode-oniguruma");
const { INITIAL, Registry, parseRawGrammar } = require("vscode-textmate");

const FILE = path.join(__dirname, "../syntaxes/koord.tmLanguage.json");
const EXAMPLES = path.join(__dirname, "../../../specs/examples");
let grammar;

before(async () => {
  const wasm = fs.readFileSync(require.resolve("vscode-oniguruma/release/onig.wasm"));
  await oniguruma.loadWASM(wasm.buffer.slice(wasm.byteOffset, wasm.byteOffset + wasm.byteLength));
  const registry = new Registry({
    onigLib: Promise.resolve({
      createOnigScanner: (patterns) => new oniguruma.OnigScanner(patterns),
      createOnigString: (text) => new oniguruma.OnigString(text),
    }),
    loadGrammar: async () => parseRawGrammar(fs.readFileSync(FILE, "utf-8"), FILE),
  });
  grammar = await registry.loadGrammar("source.koord");
});

function scopes(text) {
  const found = [];
  let state = INITIAL;
  for (const line of text.split("\n")) {
    const { tokens, ruleStack } = grammar.tokenizeLine(line, state);
    state = ruleStack;
    for (const token of tokens) {
      const word = line.slice(token.startIndex, token.endIndex).trim();
      if (word) found.push([word, token.scopes.at(-1)]);
    }
  }
  return found;
}

function scope(text, word) {
  const found = scopes(text).find(([each]) => each === word);
  assert.ok(found, `${word} is no token of ${text}`);
  return found[1];
}

for (const [text, word, expected] of [
  ["local:", "local", "storage.type.koord"],
  ["Assign:", "Assign", "entity.name.event.koord"],
  ["urgent Go:", "Go", "entity.name.event.koord"],
  ["  pre: not done", "not", "keyword.operator.word.koord"],
  ["  if x: stop", "if", "keyword.control.koord"],
  ["  eff: atomic:", "atomic", "keyword.control.koord"],
  ["def fun f(int a) -> int:", "f", "entity.name.function.koord"],
  ["def fun f(int a) -> int:", "int", "support.type.primitive.koord"],
  ["invariant Safe at round: true", "Safe", "entity.name.section.koord"],
  ["invariant Safe: true", "true", "constant.language.koord"],
  ["enum Mode: idle", "Mode", "entity.name.type.koord"],
  ["  x = findPath(a, b)", "findPath", "support.function.koord"],
  ["  x = length(list)", "length", "support.function.builtin.koord"],
  ["  x = Motion.psn", "Motion", "support.class.koord"],
  ["  x = Motion.psn", "psn", "support.variable.property.koord"],
  ["  x = pid", "pid", "variable.language.koord"],
  ["  x = 1.5e3", "1.5e3", "constant.numeric.koord"],
  ['  stdout << "if"', "if", "string.quoted.double.koord"],
  ["  x = 1 # if", "# if", "comment.line.koord"],
  ["  sensors:", "sensors", "storage.type.koord"],
  ["  sensors = 1", "sensors", "source.koord"],
  ["  localised = 1", "localised", "source.koord"],
]) {
  test(`${word} in \`${text}\` is ${expected}`, () => {
    assert.strictEqual(scope(text, word), expected);
  });
}

test("every example is read, and no string or comment runs on", () => {
  const files = fs.readdirSync(EXAMPLES).filter((name) => name.endsWith(".krd"));
  assert.ok(files.length > 10);
  for (const name of files) {
    const text = fs.readFileSync(path.join(EXAMPLES, name), "utf-8");
    const last = scopes(`${text}\nlocal:\n`).at(-2);
    assert.deepStrictEqual(last, ["local", "storage.type.koord"], name);
  }
});
