"""The rules of ``specs/semantics/`` are cited where they are implemented and where they are tested.

A rule is a heading ``### [ID] Title``. A citation is its id in square brackets in a comment or in a
docstring, so that program texts and subscripts in code are never taken for one.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
SPEC = ROOT / "specs" / "semantics"
DECISIONS = ROOT / "specs" / "decisions"

#: Where brackets around a single word in capitals can only be a citation. Elsewhere they may be
#: a usage line or a field of a packet, and are citations if a rule has that name.
CITING = ("koord/semantics", "koord/verify", "tests/semantics", "tests/verify")

HEADING = re.compile(r"^### \[([^\]]*)\] (\S.*)$", re.MULTILINE)
ROW = re.compile(r"^\| ([A-Z][A-Z0-9-]*) \| \[(\d\d)\]\((\S+)\) \|", re.MULTILINE)
ID = r"[A-Z][A-Z0-9]*(?:-[A-Z0-9]+)*"

#: An id in brackets, neither a subscript (``x[N]``) nor the text of a link.
BRACKETED = re.compile(rf"(?<![\w\])}}`])\[({ID})\](?!\()")
FENCED = re.compile(r"^( {4}.*|```.*?^```)$", re.MULTILINE | re.DOTALL)


class Citation(NamedTuple):
    """An id in brackets, and where it stands."""

    rule: str
    path: str
    line: int

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: [{self.rule}]"


# --- the spec -----------------------------------------------------------------------------------


def chapters() -> list[Path]:
    """The numbered files of the spec, in order."""
    return sorted(SPEC.glob("[0-9][0-9]-*.md"))


@cache
def headings() -> tuple[tuple[str, str], ...]:
    """Each rule's id with the file that states it, in the order of the text."""
    return tuple(
        (found[1], path.name)
        for path in chapters()
        for found in HEADING.finditer(path.read_text(encoding="utf-8"))
    )


RULES = tuple(rule for rule, _ in headings())


# --- citations ----------------------------------------------------------------------------------


def could_be_id(text: str) -> bool:
    """Whether a bracketed text is of the form of an id, and no character class or letter."""
    return len(text) > 2 and any(len(part) > 1 for part in text.split("-"))


def prose(source: str) -> Iterator[tuple[int, str]]:
    """The comments and docstrings of a Python file, each with its first line's number."""
    behind = (line[line.index("#") :] for line in source.splitlines() if "#" in line)
    if any(map(BRACKETED.search, behind)):  # or there is no citation in comments
        for token in tokenize.generate_tokens(io.StringIO(source).readline):
            if token.type == tokenize.COMMENT:
                yield token.start[0], token.string
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Expr(value=ast.Constant(value=str(text))):
                yield node.lineno, text


def cited(source: str, path: str) -> Iterator[Citation]:
    """Every id in brackets in a Python file's comments and docstrings."""
    if not any(could_be_id(found) for found in BRACKETED.findall(source)):
        return  # most files cite nothing, and are not taken apart
    for start, text in prose(source):
        for found in BRACKETED.finditer(text):
            if could_be_id(found[1]):
                line = start + text.count("\n", 0, found.start())
                yield Citation(found[1], path, line)


@cache
def citations(folder: str) -> tuple[Citation, ...]:
    """The citations in every Python file below a folder of the project."""
    return tuple(
        citation
        for path in sorted((ROOT / folder).rglob("*.py"))
        for citation in cited(path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix())
    )


def is_dangling(citation: Citation) -> bool:
    """Whether a citation names no rule, and is meant as one."""
    if citation.rule in RULES:
        return False
    return "-" in citation.rule or citation.path.startswith(CITING)


# --- tests --------------------------------------------------------------------------------------


def test_ids_are_well_formed_and_used_once() -> None:
    assert len(RULES) > 50
    assert [rule for rule in RULES if not re.fullmatch(ID, rule) or not could_be_id(rule)] == []
    assert sorted(RULES) == sorted(set(RULES))


def test_the_index_lists_every_rule_in_order() -> None:
    rows = ROW.findall((SPEC / "README.md").read_text(encoding="utf-8"))
    assert [(rule, name) for rule, _, name in rows] == list(headings())
    assert all(name.startswith(number) for _, number, name in rows)


def test_chapters_and_decisions_name_only_rules_that_exist() -> None:
    dangling = [
        f"{path.name}: [{found[1]}]"
        for path in (*SPEC.glob("*.md"), *DECISIONS.glob("*.md"))
        for found in BRACKETED.finditer(FENCED.sub("", path.read_text(encoding="utf-8")))
        if could_be_id(found[1]) and found[1] not in (*RULES, "ID", "RULE-ID")
    ]
    assert dangling == []


def test_decisions_name_the_rules_that_they_are_behind() -> None:
    records = sorted(DECISIONS.glob("[0-9]*.md"))
    assert [path.name[:4] for path in records] == [f"{n:04}" for n in range(1, len(records) + 1)]
    for path in records:
        text = path.read_text(encoding="utf-8")
        last = text.strip().splitlines()[-1]
        assert last.startswith("Rules: "), path.name
        named = last.removeprefix("Rules: ").rstrip(".").split(", ")
        # Of vehicles, say, the semantics has no rule.
        assert named == ["none"] or set(named) <= set(RULES), path.name
        assert len(text.splitlines()) <= 60, path.name


@pytest.mark.parametrize("rule", RULES)
def test_rule_is_implemented(rule: str) -> None:
    assert [c for c in citations("koord") if c.rule == rule], f"nothing in koord/ cites [{rule}]"


@pytest.mark.parametrize("rule", RULES)
def test_rule_is_tested(rule: str) -> None:
    assert [c for c in citations("tests") if c.rule == rule], f"no test cites [{rule}]"


def test_no_citation_dangles() -> None:
    found = (*citations("koord"), *citations("tests"))
    assert [str(citation) for citation in found if is_dangling(citation)] == []


def test_what_counts_as_a_citation() -> None:
    source = (
        '"""Module. \n\n[A-RULE] and [OTHER], not [A-Z], [N], x[A-SUBSCRIPT] or [A-LINK](b)."""\n'
        "x = d[A-B]  # [IN-COMMENT]\n"
        'y = "[IN-STRING]"\n'
        "def f():\n"
        '    """[IN-FUNCTION]"""\n'
    )
    found = [(c.rule, c.line) for c in cited(source, "koord/x.py")]
    assert sorted(found) == [("A-RULE", 3), ("IN-COMMENT", 4), ("IN-FUNCTION", 7), ("OTHER", 3)]
    assert is_dangling(Citation("NO-SUCH-RULE", "koord/cli/x.py", 1))
    assert is_dangling(Citation("NONESUCH", "koord/semantics/x.py", 1))
    assert not is_dangling(Citation("FILE", "koord/cli/x.py", 1))
    assert not any(is_dangling(Citation(rule, "koord/semantics/x.py", 1)) for rule in RULES)
