"""What the pages of `docs/` show is so: commands print it, and programs are checked and run.

A page's blocks are taken in order in a folder of its own, where files are that have a title
(```koord title="door.krd"). What stands behind `<!-- slow -->` is left to the slow test, and
nothing that is not slow rests on it.
"""

from __future__ import annotations

import doctest
import re
import shlex
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import koord
from docs.generator.site import DOCS, ROOT
from koord.cli.main import main
from koord.syntax.parsing import line_forms
from koord.syntax.parsing.table import Rule, table
from koord.syntax.parsing.tokens import KEYWORDS
from tests.test_readme import MOVED, agrees, masked, told

LANGUAGE = DOCS / "reference" / "language.md"

_BLOCK = re.compile(
    r"^(?P<slow><!-- slow -->\n)?```(?P<language>\w+)(?: title=\"(?P<file>[\w.]+)\")?\n"
    r"(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


class Block(NamedTuple):
    """A block of a page."""

    language: str
    file: str  #: the file that it is to be written to, or ""
    text: str
    is_slow: bool


def blocks(page: Path) -> list[Block]:
    """All blocks of a page that say what they are."""
    text = page.read_text(encoding="utf-8")
    found = [
        Block(one["language"], one["file"] or "", one["text"], one["slow"] is not None)
        for one in _BLOCK.finditer(text)
    ]
    assert sum(one.language == "console" for one in found) == text.count("```console")
    assert sum(one.is_slow for one in found) == text.count("<!-- slow -->")
    return found


def _pages() -> list[Path]:
    """All pages but those whose commands tests/test_readme.py tries, in their order."""
    return sorted({*DOCS.rglob("*.md")} - {ROOT / name for name in MOVED})


def _name(page: Path) -> str:
    return page.relative_to(DOCS).as_posix()


def _with_commands(is_slow: bool) -> list[Path]:
    return [
        page
        for page in _pages()
        if any(one.language == "console" and (one.is_slow or not is_slow) for one in blocks(page))
    ]


@pytest.mark.parametrize("page", _with_commands(False), ids=_name)
def test_commands_print_what_is_shown(
    page: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    _try(page, tmp_path, monkeypatch, capsys, with_slow=False)


@pytest.mark.slow
@pytest.mark.parametrize("page", _with_commands(True), ids=_name)
def test_commands_that_take_long_print_what_is_shown(
    page: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    _try(page, tmp_path, monkeypatch, capsys, with_slow=True)


def _try(
    page: Path,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    *,
    with_slow: bool,
) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "100")
    for name in ("specs", "tests"):
        (folder / name).symlink_to(ROOT / name)
    shim = folder / "koord"
    shim.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m koord "$@"\n', encoding="utf-8")
    shim.chmod(0o755)
    for block in blocks(page):
        if block.file:
            (folder / block.file).write_text(block.text, encoding="utf-8")
        if block.language != "console" or (block.is_slow and not with_slow):
            continue
        for command, expected in shown(block.text):
            printed = _printed(folder, command, capsys)
            assert agrees(_masked(command, expected), _masked(command, printed)), printed


def shown(text: str) -> Iterator[tuple[str, str]]:
    """The commands of a block, each with what it prints."""
    assert text.startswith("$ ")
    for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        command, _, printed = part.partition("\n")
        yield command, printed


def _printed(folder: Path, command: str, capsys: pytest.CaptureFixture[str]) -> str:
    """What a command prints: in this process if it is one of koord's alone, which is quicker."""
    if not command.startswith("koord ") or re.search(r"[|&;<>]|\bdeploy\b", command):
        return told(folder, command).stdout
    try:
        main(shlex.split(command)[1:])
    finally:
        out, err = capsys.readouterr()
    return out + err


def _masked(command: str, text: str) -> str:
    """The text without times, and without what differs from run to run."""
    return re.sub(r"; \d+\.\d\d s$", "; - s", masked(command, text), flags=re.MULTILINE)


def test_blocks_are_found_with_their_files() -> None:
    found = blocks(DOCS / "tutorial" / "index.md")
    assert [one.file for one in found if one.file] == ["door.krd", "safe_door.krd", "door.yaml"]
    assert {one.is_slow for one in found if one.language == "console"} == {True, False}
    assert list(shown("$ a b\nc\n$ d\n")) == [("a b", "c\n"), ("d", "")]


# --- programs and Python --------------------------------------------------------------------------


def _programs() -> list[tuple[str, str]]:
    return [
        (f"{_name(page)}-{i}", one.text)
        for page in _pages()
        if _name(page) not in ("published_programs.md",)
        for i, one in enumerate(blocks(page))
        if one.language == "koord" and one.file != "door.krd"
    ]


@pytest.mark.parametrize(("name", "text"), _programs())
def test_programs_have_no_mistake_and_run(name: str, text: str) -> None:
    source = koord.Source(f"{name}.krd", text)
    assert koord.check(source).diagnostics == ()
    report = koord.run(koord.load(source), rounds=4)
    assert report.fault is None


def test_what_is_shown_of_python_is_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "specs").symlink_to(ROOT / "specs")
    parser = doctest.DocTestParser()
    for page in _pages():
        text = "".join(one.text for one in blocks(page) if one.text.startswith(">>>"))
        heard: list[str] = []
        doctest.DocTestRunner().run(
            parser.get_doctest(text, {}, _name(page), None, 0), out=heard.append
        )
        assert heard == []


# --- the language is told as a whole --------------------------------------------------------------


#: Forms that are read and refused or warned of: `return` without a value, `(x, y, z)`.
UNTOLD = {"return_plain", "position"}


def test_every_keyword_is_named_and_used() -> None:
    text = LANGUAGE.read_text(encoding="utf-8")
    programs = "".join(one.text for one in blocks(LANGUAGE) if one.language == "koord")
    spelled = {"False", "true"}  # of which the other spelling is used
    for word in KEYWORDS:
        assert f"`{word}`" in text
        assert re.search(rf"\b{word}\b", programs) or word in {*spelled, "leadsto"}, word


def test_every_form_of_the_grammar_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """The programs of the page make the parser call every method that makes a node."""
    makers, used = line_forms._makers(), set[str]()

    def heard(rule: Rule, make: Callable[[list[Any]], Any]) -> Callable[[list[Any]], Any]:
        def made(children: list[Any]) -> Any:
            used.add(rule.method)
            return make(children)

        return made

    listening = tuple(map(heard, table().rules, makers))
    monkeypatch.setattr(line_forms, "_makers", lambda: listening)
    for one in blocks(LANGUAGE):
        if one.language == "koord":
            koord.check(koord.Source("language.krd", one.text + "\n# read anew\n"))
    assert {rule.method for rule in table().rules} - used == UNTOLD
