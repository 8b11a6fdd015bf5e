"""Completions: what could stand where the cursor is.

A hole, a name that nothing declares, is put there, and the text is elaborated: whoever resolves
names says what the hole could be. Lines that are being written are seldom whole, so that the rest
of the line is tried, left out, and closed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from enum import Enum

from msgspec import Struct

from koord.syntax.editing.lines import code_of, ends_in_text
from koord.syntax.editing.model import SemanticModel
from koord.syntax.editing.symbols import Symbol, SymbolKind, library_symbols
from koord.syntax.editing.words import WORDS
from koord.syntax.elaboration.body import LOGICAL
from koord.syntax.elaboration.calls import CHANGES
from koord.syntax.elaboration.library import library, library_names
from koord.syntax.elaboration.recorder import (
    HOLE,
    Candidate,
    Hole,
    HoleKind,
    OwnName,
    Recorder,
)
from koord.syntax.elaboration.symbols import BoundSymbol, Signature
from koord.syntax.elaboration.where import Where
from koord.syntax.source import Source, Span
from koord.syntax.types import BOOL, Type, show
from koord.syntax.vocabulary import FUNCTIONS, GENERIC_TYPES, TYPES


class Rank(Enum):
    """How near a completion is; those that come first are shown first."""

    FITTING = 0  #: of the type that is wanted
    BOUND = 1
    DECLARED = 2
    LANGUAGE = 3
    LIBRARY = 4


class Completion(Struct, frozen=True):
    """A name or a form that could stand at the cursor.

    ``insert`` is what is written in place of the word there. In a snippet ``$1`` and ``${1:text}``
    are places to go through, ``$0`` the last one.
    """

    label: str
    kind: SymbolKind
    insert: str
    detail: str = ""
    story: str = ""
    rank: Rank = Rank.DECLARED
    is_snippet: bool = False


class Completions(Struct, frozen=True):
    """The completions of a place, and the word that they replace."""

    span: Span
    items: tuple[Completion, ...]


SECTION_FORMS = {
    "using": "using ${1:Motion}:\n    ",
    "local": "local:\n    ",
    "allread": "allread:\n    ",
    "allwrite": "allwrite:\n    ",
    "param": "param ${1:int} ${2:name} = ${0:0}",
    "enum": "enum ${1:Mode}: ${2:idle, busy}",
    "def fun": "def fun ${1:name}(${2:int x}) -> ${3:int}:\n    return ${0:x}",
    "def": "def ${1:Name}:\n    ${2:int} ${3:field} = ${0:0}",
    "init": "init:\n    ${0:pass}",
    "event": "${1:Name}:\n    pre: ${2:true}\n    eff:\n        ${0:pass}",
    "urgent": "urgent ${1:Name}:\n    pre: ${2:true}\n    eff:\n        ${0:pass}",
    "assume": "assume: ${0:true}",
    "invariant": "invariant ${1:Name}: ${0:true}",
    "eventually": "eventually ${1:Name}: ${0:true}",
    "agent": "agent ${1:Name}:\n    ",
}
STATEMENT_FORMS = {
    "if": "if ${1:true}:\n    ${0:pass}",
    "else": "else:\n    ${0:pass}",
    "elif": "elif ${1:true}:\n    ${0:pass}",
    "for": "for ${1:i} = 0, ${2:numAgents}:\n    ${0:pass}",
    "for in": "for ${1:x} in ${2:list}:\n    ${0:pass}",
    "repeat": "repeat ${1:2}:\n    ${0:pass}",
}
_PARTS = {
    "event": ("pre", "eff"),
    "using": ("sensors", "actuators", "environment", "contract"),
    "contract": ("requires", "ensures"),
    "extern": ("requires", "ensures"),
}
_IN_STATEMENTS = {
    Where.EFFECT: ("atomic", "pass", "stop", "trystop", "break"),
    Where.INIT: ("pass", "stop", "break"),
    Where.FUNCTION: ("return", "break"),
    Where.ENVIRONMENT: ("pass", "break"),
}
_IDENTIFIER = re.compile(r"[A-Za-z_0-9]*$")
_PAIRS = {"(": ")", "[": "]", "{": "}"}


def completions(model: SemanticModel, line: int, column: int) -> Completions:
    """What could stand at a place of the text, the likely ones first."""
    text = model.source.line_text(line)
    before, after = text[: column - 1], text[column - 1 :]
    match = _IDENTIFIER.search(before)
    word = match.group() if match else ""
    head = before[: len(before) - len(word)]
    tail = re.sub(r"^[A-Za-z_0-9]+", "", after)
    end = column + len(after) - len(tail)
    span = Span(model.source.name, line, len(head) + 1, line, end)
    if ends_in_text(head) or word[:1].isdigit():
        return Completions(span, ())
    items = list(_found(model, line, head, tail))
    unique = {(item.label, item.kind): item for item in reversed(items)}
    ordered = sorted(unique.values(), key=lambda item: (item.rank.value, item.label.lower()))
    return Completions(span, tuple(ordered))


def _found(model: SemanticModel, line: int, head: str, tail: str) -> Iterator[Completion]:
    if not head.strip():
        yield from _parts_of_block(model.source, line, len(head))
    if not head:
        return
    hole = _hole(model, line, head, tail)
    if hole is not None:
        yield from _of_hole(model, hole)
    elif head.strip() and not head.rstrip().endswith("."):
        yield from (_declared(symbol) for symbol in model.symbols)


def _hole(model: SemanticModel, line: int, head: str, tail: str) -> Hole | None:
    """The hole at the cursor, with as much of its line as can be read."""
    for attempt in _attempts(head, tail):
        lines = model.source.text.split("\n")
        lines[line - 1] = attempt
        recorder = Recorder()
        model.reloaded("\n".join(lines), recorder)
        if recorder.hole is not None:
            return recorder.hole
    return None


def _attempts(head: str, tail: str) -> Iterator[str]:
    closed = "".join(reversed([_PAIRS[sign] for sign in _unclosed(head)]))
    opens = re.match(r"\s*(if|elif|for|repeat)\b", head) is not None
    is_first = not head.strip() or head.rstrip().endswith(":")
    if is_first:
        yield f"{head}{HOLE}(){tail}" if not tail.strip() else f"{head}{HOLE}{tail}"
        yield f"{head}{HOLE} koord__name__"
    yield f"{head}{HOLE}{tail}"
    yield f"{head}{HOLE}{closed}{': pass' if opens else ''}"
    yield f"{head}{HOLE}{'>' * head.count('<')} koord__name__{closed}"
    if opens and re.match(r"\s*for\b[^=]*=", head):
        yield f"{head}{HOLE}{closed}, 1: pass"


def _unclosed(head: str) -> list[str]:
    open_: list[str] = []
    for sign in code_of(head):
        if sign in _PAIRS:
            open_.append(sign)
        elif sign in _PAIRS.values() and open_:
            open_.pop()
    return open_


# --- what a hole could be -------------------------------------------------------------------------


def _of_hole(model: SemanticModel, hole: Hole) -> Iterator[Completion]:
    for candidate in hole.candidates:
        yield _of_candidate(model, hole, candidate)
    match hole.kind:
        case HoleKind.VALUE | HoleKind.STATEMENT:
            if hole.kind is HoleKind.STATEMENT and hole.where is not None:
                yield from _statements(hole.where)
            else:
                yield from _operators(hole)
            yield from _functions(hole)
        case HoleKind.TYPE:
            for name in sorted(GENERIC_TYPES):
                arguments = "${1:int}, ${2:int}" if name == "Map" else "${1:int}"
                form = f"{name}<{arguments}>"
                yield _word(name, Rank.LANGUAGE, form, kind=SymbolKind.TYPE)
        case HoleKind.PART | HoleKind.EVENT:
            pass


def _of_candidate(model: SemanticModel, hole: Hole, candidate: Candidate) -> Completion:
    name, meaning = candidate.name, candidate.meaning
    rank = Rank.DECLARED
    if isinstance(meaning, BoundSymbol):
        rank = Rank.BOUND
    if candidate.type is not None and candidate.type == hole.expected:
        rank = Rank.FITTING
    if isinstance(meaning, OwnName):
        if name in FUNCTIONS:
            return _word(name, rank, f"{name}($1)$0")
        rank = rank if rank is Rank.FITTING else Rank.LANGUAGE
        return _word(name, rank, name)
    known = model.symbol_of(meaning)
    kind = known.kind if known is not None else SymbolKind.TYPE
    detail = known.code.split("\n")[0] if known is not None else ""
    if candidate.type is not None and not detail:
        detail = show(candidate.type)
    if hole.kind is HoleKind.TYPE:
        kind = kind if kind in (SymbolKind.RECORD, SymbolKind.ENUM) else SymbolKind.TYPE
        return Completion(name, kind, name, detail, rank=rank)
    if hole.kind is HoleKind.PART and kind is SymbolKind.MODULE:
        return _port(known, name) if known is not None else _word(name, rank, name)
    story = known.story if known is not None else ""
    if isinstance(meaning, Signature):
        insert = f"{name}({_holes(meaning.parameter_names)})$0"
        return Completion(name, kind, insert, detail, story, rank, is_snippet=True)
    return Completion(name, kind, name, detail, story, rank)


def _port(module: Symbol, name: str) -> Completion:
    """A port of a library's module that the program does not use yet."""
    for symbol in library_symbols():
        if symbol.kind is SymbolKind.MODULE and symbol.name == module.name:
            for child in symbol.children:
                if child.name == name:
                    return _declared(child)
    return Completion(name, SymbolKind.SENSOR, name, f"a port of {module.name}")


def _statements(where: Where) -> Iterator[Completion]:
    for name, form in STATEMENT_FORMS.items():
        yield _word(name, Rank.LANGUAGE, form)
    for name in _IN_STATEMENTS.get(where, ()):
        form = "atomic:\n    ${0:pass}" if name == "atomic" else name
        yield _word(name, Rank.LANGUAGE, form)
    if where in (Where.FUNCTION, Where.ENVIRONMENT):
        for name in sorted(TYPES - {"stream"}):
            yield _word(name, Rank.LANGUAGE, name, kind=SymbolKind.TYPE)
    if where in (Where.EFFECT, Where.INIT):
        yield _word("stdout", Rank.LANGUAGE, "stdout << $0")


def _operators(hole: Hole) -> Iterator[Completion]:
    fits = Rank.FITTING if hole.expected == BOOL else Rank.LANGUAGE
    for name in ("true", "false", "not"):
        yield _word(name, fits, name)
    yield _word("pi", Rank.LANGUAGE, "pi")
    if hole.where in LOGICAL:
        yield _word("forall", fits, "forall ${1:i}: $0")
        yield _word("exists", fits, "exists ${1:i}: $0")


def _functions(hole: Hole) -> Iterator[Completion]:
    changing = hole.kind is HoleKind.STATEMENT
    for name in sorted(FUNCTIONS):
        if (name in CHANGES) == changing and _has_place(name, hole.where):
            yield _word(name, Rank.LANGUAGE, f"{name}($1)$0")
    if changing or hole.where is Where.CONSTANT:
        return
    callable_ = set(library_names())
    for symbol in library_symbols():
        if symbol.name in callable_ and symbol.kind in (SymbolKind.FUNCTION, SymbolKind.EXTERNAL):
            names = [child.name for child in symbol.children]
            rank = Rank.LIBRARY
            if hole.expected is not None and _gives(symbol.name, hole.expected):
                rank = Rank.FITTING
            detail = symbol.code.split("\n")[0]
            insert = f"{symbol.name}({_holes(names)})$0"
            yield Completion(
                symbol.name, symbol.kind, insert, detail, symbol.story, rank, is_snippet=True
            )


def _has_place(name: str, where: Where | None) -> bool:
    if name == "ran":
        return where in (Where.PROPERTY, Where.ASSUMPTION)
    if name == "choose":
        return where in (Where.ENVIRONMENT, Where.INIT, Where.PROPERTY, Where.ASSUMPTION)
    return True


def _gives(name: str, wanted: Type) -> bool:
    """Return whether a function of the library answers with a type, by how it is written."""
    results = (definition.result for definition in library().functions[name])
    return any(getattr(result, "name", "") == show(wanted) for result in results)


def _holes(names: Sequence[str]) -> str:
    return ", ".join(f"${{{number}:{name}}}" for number, name in enumerate(names, 1))


def _declared(symbol: Symbol) -> Completion:
    detail = symbol.code.split("\n")[0]
    return Completion(symbol.name, symbol.kind, symbol.name, detail, symbol.story)


def _word(name: str, rank: Rank, form: str, *, kind: SymbolKind = SymbolKind.WORD) -> Completion:
    known = WORDS.get(name.partition(" ")[0])
    detail, story = (known.form, known.meaning) if known is not None else ("", "")
    return Completion(name, kind, form, detail, story, rank, is_snippet="$" in form)


# --- sections and their parts ---------------------------------------------------------------------


def _parts_of_block(source: Source, line: int, indent: int) -> Iterator[Completion]:
    """The words that can begin a line, by the block that its indentation puts it into."""
    head = _head(source, line, indent)
    if head is None or head.startswith("agent "):
        for name, form in SECTION_FORMS.items():
            if head is None or name != "agent":
                yield _word(name, Rank.DECLARED, form)
        return
    first = head.partition(" ")[0].partition(":")[0]
    block = first if first in _PARTS else "event"
    if first == "def" and "extern" in head:
        block = "extern"
    if block == "event" and re.fullmatch(r"(urgent +)?\w+ *:?", head) is None:
        return
    if block == "event" and first in WORDS and first != "urgent":
        return
    for name in _PARTS[block]:
        form = f"{name} ${{1:Name}}:\n    " if name == "contract" else f"{name}: $0"
        yield _word(name, Rank.BOUND, form)


def _head(source: Source, line: int, indent: int) -> str | None:
    """The line that opens the block of a line with this indentation; None at the left margin."""
    if indent == 0:
        return None
    for number in range(line - 1, 0, -1):
        text = source.line_text(number)
        is_code = text.strip() and not text.strip().startswith(("#", "//"))
        if is_code and len(text) - len(text.lstrip()) < indent:
            return text.strip()
    return None
