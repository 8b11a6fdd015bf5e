"""The library is read in parts, which are those of the whole."""

from __future__ import annotations

from pathlib import Path

from koord.syntax import ast
from koord.syntax.elaboration import library as room
from koord.syntax.elaboration.library import LIBRARY, library
from koord.syntax.parsing.parser import parse
from koord.syntax.source import Source, normalise


def whole() -> tuple[ast.Section, ...]:
    text = (Path(room.__file__).parents[1] / LIBRARY).read_text("utf-8")
    parsed = parse(Source(LIBRARY, normalise(text)))
    assert not parsed.diagnostics
    return tuple(parsed.program.sections)


def test_each_definition_is_that_of_the_whole_with_its_place() -> None:
    known = library()
    functions = [section for section in whole() if isinstance(section, ast.FunDef)]
    assert list(known.functions) == list(dict.fromkeys(f.name.name for f in functions))
    assert len(known.functions) > 20
    for name, definitions in known.functions.items():
        expected = [f for f in functions if f.name.name == name]
        assert [str(d) for d in definitions] == [str(e) for e in expected]
        assert [(d.span, d.name.span) for d in definitions] == [
            (e.span, e.name.span) for e in expected
        ]


def test_modules_and_the_task_are_those_of_the_whole() -> None:
    known, sections = library(), whole()
    assert [*known.modules.values()] == [x for x in sections if isinstance(x, ast.Using)]
    assert [known.task] == [x for x in sections if isinstance(x, ast.RecordDef)]


def test_what_is_not_there_is_not_found() -> None:
    assert library().functions.get("findNothing", ()) == ()
    assert "findPath" in library().functions
