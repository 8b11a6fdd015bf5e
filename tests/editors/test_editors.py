"""Grammars of editors: made of the one list of words, and read by the editors themselves."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from editors.generate import FOLDER, files, main, outdated, textmate
from koord.lsp.settings import LspSettings, VerifySettings
from koord.syntax import vocabulary

NODE, VIM = shutil.which("node"), shutil.which("vim")
MODULES = FOLDER / "vscode" / "node_modules"


def test_what_is_generated_is_up_to_date() -> None:
    """`python -m editors.generate` makes it so."""
    assert outdated() == []
    assert main(["--check"]) == 0


def test_every_word_is_in_every_grammar() -> None:
    words = (
        vocabulary.KEYWORDS
        | vocabulary.TYPES
        | vocabulary.GENERIC_TYPES
        | vocabulary.OWN_NAMES
        | vocabulary.FUNCTIONS
        | vocabulary.CONTEXTUAL
    )
    for path, text in files().items():
        if path.suffix != ".vim" and "tmLanguage" not in path.name:
            continue
        known = set(re.findall(r"[A-Za-z]+", text.replace(r"\\b", " ")))
        assert words - known <= {"module"}, path.name  # Vim shows it as any name


def test_patterns_are_regular_expressions() -> None:
    patterns = textmate()["patterns"]
    assert isinstance(patterns, list)
    for pattern in patterns:
        re.compile(pattern.get("match") or pattern["begin"])


def test_the_settings_of_the_extension_are_those_of_the_server() -> None:
    manifest = json.loads((FOLDER / "vscode/package.json").read_text("utf-8"))
    named = set(manifest["contributes"]["configuration"]["properties"]) - {"koord.command"}
    own = {f"koord.{name}" for name in LspSettings.__struct_encode_fields__}
    verify = {f"koord.verify.{name}" for name in VerifySettings.__struct_encode_fields__}
    assert named <= own | verify
    extension = (FOLDER / "vscode/extension.js").read_text("utf-8")
    sent = {f"koord.{name}" for name in re.findall(r'own\.get\("([\w.]+)"\)', extension)}
    assert sent == named


@pytest.mark.skipif(NODE is None or not MODULES.is_dir(), reason="`make editors` installs it")
def test_the_extension_passes_its_own_tests() -> None:
    """One of them runs the extension with a real server; VS Code itself is a stand-in."""
    assert NODE is not None
    done = subprocess.run(
        [NODE, "--test", *map(str, sorted(MODULES.parent.glob("test/*.test.js")))],
        cwd=FOLDER / "vscode",
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.skipif(VIM is None, reason="Vim is not here")
def test_vim_tells_words_apart(tmp_path: Path) -> None:
    assert VIM is not None
    lines = [
        "Go:",
        "    pre: not x and length(list) > 0",
        '    eff: atomic: x = findPath("if") # if',
        "def fun f(int a) -> int: extern fresh",
        "using Motion:",
        "    sensors:",
        "invariant A: a++b || c",
    ]
    wanted = {
        (1, "Go"): "koordEvent",
        (2, "pre"): "koordSection",
        (2, "not"): "koordOperator",
        (2, "length"): "koordBuiltin",
        (2, "list"): "",
        (3, "atomic"): "koordStatement",
        (3, "findPath"): "koordLibrary",
        (3, '"if'): "koordString",
        (3, "# if"): "koordComment",
        (4, "fun"): "koordSection",
        (4, "int"): "koordType",
        (4, "extern"): "koordModifier",
        (5, "Motion"): "koordModule",
        (6, "sensors"): "koordSection",
        (7, "++"): "koordSign",
        (7, "||"): "koordSign",
        (7, "b ||"): "",
    }
    program, output = tmp_path / "a.krd", tmp_path / "output"
    program.write_text("\n".join(lines) + "\n")
    places = [[line, lines[line - 1].index(word) + 1] for line, word in wanted]
    show = 'echo synIDattr(synID(p[0], p[1], 1), "name") . ";"'
    commands = [
        f"set rtp^={FOLDER / 'vim'}",
        "syntax on",
        f"edit {program}",
        "set ft=koord",
        f"redir! > {output}",
        f"for p in {places} | {show} | endfor",
        "echo v:errmsg",
        "redir END",
        "qa!",
    ]
    arguments = [part for command in commands for part in ("-c", command)]
    # silent as it is, its exit code tells of no error; the last one is told behind the names
    subprocess.run([VIM, "-u", "NONE", "-es", *arguments], check=False, timeout=60)
    *found, error = (name.strip() for name in output.read_text().split(";"))
    if not found:
        pytest.skip("this Vim has no syntax")
    assert error == ""
    assert dict(zip(wanted, found, strict=True)) == wanted
