"""The library, ``prelude.krd``: functions and modules that every program may use."""

from __future__ import annotations

import os
import re
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from enum import Enum
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise

from msgspec import Struct

from koord.syntax import ast
from koord.syntax.content import content_fields
from koord.syntax.elaboration.body import BodyScope, Elaboration, Where
from koord.syntax.elaboration.findings import DiagnosticLog
from koord.syntax.elaboration.resolve_types import resolve
from koord.syntax.elaboration.symbols import Signature
from koord.syntax.parsing.parser import parse
from koord.syntax.source import Source, Span, normalise

#: The file of the library; places in it are of no program.
LIBRARY = "prelude.krd"

_FILE = os.path.join(os.path.dirname(__file__), os.pardir, LIBRARY)

#: Ports of library modules that go by two names; the second is the one that is kept.
PORT_ALIASES: Mapping[str, Mapping[str, str]] = {
    "Motion": {"position": "psn", "done": "reached"},
    "MotionWithScan": {"position": "psn", "done": "reached"},
}

#: Functions that operators are made of; programs do not call them.
_INTERNAL = frozenset(
    {"negatedPos", "addedPos", "subtractedPos", "scaledPos", "dividedPos", "joinedText", "textOf"}
)


class Library(Struct, frozen=True):
    """The definitions of the prelude by name."""

    functions: Mapping[str, tuple[ast.FunDef, ...]]
    modules: Mapping[str, ast.Using]
    task: ast.RecordDef


class _Functions(Mapping[str, tuple[ast.FunDef, ...]]):
    """The functions of the prelude, each read when it is asked for: few programs call many."""

    def __init__(self, lines: Sequence[str], places: Mapping[str, Sequence[range]]) -> None:
        self._lines, self._places = lines, places
        self._read: dict[str, tuple[ast.FunDef, ...]] = {}

    def __getitem__(self, name: str) -> tuple[ast.FunDef, ...]:
        if name not in self._read:
            sections = _sections(self._lines, self._places[name])
            found = tuple(each for each in sections if isinstance(each, ast.FunDef))
            assert len(found) == len(self._places[name])
            self._read[name] = found
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


def library_path() -> str:
    """The path of the prelude."""
    return os.path.abspath(_FILE)


def library_text() -> str:
    """The text of the prelude."""
    with open(_FILE, encoding="utf-8") as file:
        return normalise(file.read())


@lru_cache(maxsize=1)
def library() -> Library:
    """The prelude, read once."""
    lines = library_text().split("\n")
    places: dict[str, list[range]] = {}
    others: list[range] = []
    for block in _blocks(lines):
        function = re.match(_FUNCTION, lines[block.start])
        (others if function is None else places.setdefault(function[1], [])).append(block)
    modules: dict[str, ast.Using] = {}
    task: ast.RecordDef | None = None
    for section in _sections(lines, others):
        match section:
            case ast.Using(module=module):
                modules[module.name] = section
            case ast.RecordDef():
                task = section
    assert task is not None
    return Library(_Functions(lines, places), modules, task)


#: How the definition of a function begins.
_FUNCTION = r"def fun (\w+)\("


def _blocks(lines: Sequence[str]) -> Iterator[range]:
    """The lines of each definition of the prelude: one that is not indented, and what is below."""
    starts = [n for n, line in enumerate(lines) if line and line[0] not in " #"]
    for start, end in pairwise([*starts, len(lines)]):
        yield range(start, end)


def _sections(lines: Sequence[str], blocks: Iterable[range]) -> tuple[ast.Section, ...]:
    """Some definitions of the prelude, with the places where they stand in it."""
    wanted = {number for block in blocks for number in block}
    text = "\n".join(line if n in wanted else "" for n, line in enumerate(lines))
    parsed = parse(Source(LIBRARY, text))
    assert not parsed.diagnostics, parsed.diagnostics
    return tuple(parsed.program.sections)


def library_ports() -> dict[str, frozenset[str]]:
    """The ports of each module of the library, by all their names."""
    return {
        name: frozenset(
            [decl.name.name for decl in (*module.sensors, *module.actuators)]
            + list(PORT_ALIASES.get(name, ()))
        )
        for name, module in library().modules.items()
    }


def library_names() -> list[str]:
    """The functions of the library that programs may call."""
    return [name for name in library().functions if name not in _INTERNAL]


def library_signatures(session: Elaboration, name: str) -> tuple[Signature, ...]:
    """The library's functions of that name, typed for this program."""
    table = session.functions
    found = table.library.get(name)
    if found is None:
        definitions = library().functions.get(name, ())
        found = tuple(
            signature(session, definition, _unique(session, name, number), library=True)
            for number, definition in enumerate(definitions, 1)
        )
        table.library[name] = found
    return found


def _unique(session: Elaboration, name: str, number: int) -> str:
    """The name in the core program, which no function of the user has."""
    wanted = name if number == 1 else f"{name}_{number}"
    while wanted in session.functions.own:
        wanted = f"library_{wanted}"
    return wanted


def signature(
    session: Elaboration, definition: ast.FunDef, name: str, *, library: bool
) -> Signature:
    """The signature of a function. Errors in the library's types are reported at its calls."""
    findings = DiagnosticLog() if library else session.findings
    body = BodyScope(session, Where.CONSTANT, None, findings)
    parameters = tuple(resolve(body, decl.type) for decl in definition.parameters)
    result = resolve(body, definition.result) if definition.result is not None else None
    sound = all(parameters) and (result is not None or definition.result is None)
    return Signature(
        name,
        definition.name.name,
        parameters,
        tuple(decl.name.name for decl in definition.parameters),
        result,
        sound,
        definition,
        library,
    )


_LEAVES = (str, int, Fraction, Enum, type(None), Span, ast.Comment)


def mentioned(program: ast.Program, variables: Container[str]) -> dict[str, Span]:
    """The names in expressions that are not those of variables, and those of ports of modules.

    Each with the first place where it stands.
    """
    parts: dict[type, tuple[str, ...]] = {}
    names: dict[str, Span] = {}

    def note(name: str, span: Span) -> None:
        first = names.setdefault(name, span)
        if (span.line, span.column) < (first.line, first.column):
            names[name] = span

    modules = set(_modules(program.sections))
    stack: list[object] = [program.sections]
    while stack:
        node = stack.pop()
        if isinstance(node, tuple):
            stack.extend(node)
            continue
        kind = type(node)
        if kind is ast.Name:
            assert isinstance(node, ast.Name)
            if node.name not in variables:
                note(node.name, node.span)
            continue
        if kind is ast.Attribute:
            assert isinstance(node, ast.Attribute)
            if isinstance(node.base, ast.Name) and node.base.name in modules:
                note(node.name.name, node.name.span)
            else:
                stack.append(node.base)
            continue
        if kind is ast.MethodCall or kind is ast.Call:
            assert isinstance(node, ast.MethodCall | ast.Call)
            called = node.method if isinstance(node, ast.MethodCall) else node.function
            if called.name == "planner":  # it plans from where the robot is [OLD-PLANNER]
                note("psn", called.span)
        known = parts.get(kind)
        if known is None:
            known = () if isinstance(node, _LEAVES) else _parts(node)
            parts[kind] = known
        for part in known:
            stack.append(getattr(node, part))
    return names


def _modules(sections: Iterable[ast.Section]) -> Iterator[str]:
    for section in sections:
        if isinstance(section, ast.Using):
            yield section.module.name
        elif isinstance(section, ast.Agent):
            yield from _modules(section.sections)


def _parts(node: object) -> tuple[str, ...]:
    if isinstance(node, ast.Ident):
        return ()
    assert isinstance(node, ast.Node)
    return content_fields(type(node))
