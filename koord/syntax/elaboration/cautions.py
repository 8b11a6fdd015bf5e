"""Warnings: what is allowed and hardly meant, and what is read and never set."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import assert_never

from koord.syntax import ast, core
from koord.syntax.analysis.bounds import contradicting
from koord.syntax.analysis.folding import constant
from koord.syntax.diagnostics import Note
from koord.syntax.elaboration.body import BodyScope, Confusion, Elaboration, MissingFunction
from koord.syntax.elaboration.phrases import listed
from koord.syntax.elaboration.starts import Key, key, places_read, takes_tasks
from koord.syntax.elaboration.symbols import Named, ParamSymbol, VariableSymbol
from koord.syntax.source import Span
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    POS,
    STRING,
    ArrayType,
    EnumType,
    GrowingType,
    MapType,
    RecordType,
    Type,
    show,
)
from koord.syntax.walk import nodes, written


def never_enabled(session: Elaboration, event: ast.Event, guard: core.Expr) -> None:
    """Warn of an event whose guard is false in every configuration."""
    if constant(guard) is False or contradicting([guard]) is not None:
        assert event.pre is not None
        session.findings.warning(
            "K402",
            event.pre.span,
            f"the event `{event.name.name}` is never enabled: its guard is always false",
        )


def lost_updates(body: BodyScope, guarded: frozenset[int], effect: core.Block) -> None:
    """Warn of allwrite variables that an event reads, and writes outside of `atomic`.

    ``guarded`` are those that its guard reads. There, a write that is the same for every robot (a
    flag that is taken back) is no matter of who comes first.
    """
    told: set[int] = set()
    differing = {s.place.span for s in nodes(effect) if isinstance(s, core.Assign) and _differs(s)}
    for write in body.writes:
        slot = write.variable.slot
        if write.block is not None or write.own or slot in told:
            continue
        if slot in body.shared_reads:
            read, cure = "read and written", "put both under `atomic:`"
        elif slot in guarded and write.span in differing:
            read, cure = "read in the guard and written", "put the write under `atomic:`"
        else:
            continue
        told.add(slot)
        body.findings.warning(
            "K401",
            write.span,
            f"`{write.variable.name}` is {read} outside `atomic`: "
            "of two robots that do so in one round, one loses its update",
            cure,
        )


def _differs(statement: core.Assign) -> bool:
    """Return whether two robots may write different values."""
    return any(isinstance(node, core.Place | core.Pid) for node in nodes(statement.value))


def contradictions(
    session: Elaboration,
    agents: Iterable[core.Agent],
    assumptions: Iterable[core.Assumption],
    externals: Iterable[core.External],
) -> None:
    """Warn of conditions that never hold, which make claims vacuous."""
    _never(session, [a.condition for a in assumptions], "this assumption", "nothing can begin")
    for agent in agents:
        for module in agent.modules:
            for contract in module.contracts:
                empty = "the contract promises nothing"
                _never(session, contract.requires, "this `requires:`", empty)
                kept = "no environment can keep it"
                _never(session, contract.ensures, "this `ensures:`", kept)
    for external in externals:
        _never(session, external.requires, "this `requires:`", "every call is a fault")
        _never(session, external.ensures, "this `ensures:`", "no function can keep it")


def _never(
    session: Elaboration, conditions: Sequence[core.Expr], what: str, consequence: str
) -> None:
    false = [condition for condition in conditions if constant(condition) is False]
    for condition in false:
        session.findings.warning("K404", condition.span, f"{what} is always false: {consequence}")
    part = contradicting(conditions) if not false else None
    if part is not None:
        story = f"{what} contradicts what is said before it: {consequence}"
        session.findings.warning("K404", part.span, story)


def unused(session: Elaboration, scopes: Iterable[dict[str, Named]]) -> None:
    """Warn of variables and params that are never used."""
    for scope in scopes:
        for name, symbol in scope.items():
            wrong = isinstance(symbol, ParamSymbol) and symbol.value is None
            if wrong or name in session.ambiguous or id(symbol.declared) in session.used:
                continue
            if isinstance(symbol, VariableSymbol | ParamSymbol):
                what = "param" if isinstance(symbol, ParamSymbol) else "variable"
                shadowed = name in session.loop_variables
                session.findings.warning(
                    "K403",
                    symbol.declared.span,
                    f"the {what} `{name}` is never used",
                    "a `for` loop declares its own variable: leave this one out"
                    if shadowed
                    else None,
                )


#: What stands above declarations that are made for a program.
_STUBS = "# Nothing is said of what these functions answer: each answer is any value of its type.\n"


def missing_functions(session: Elaboration) -> None:
    """Report the functions that nobody declares, in one message with their declarations."""
    missing = sorted(session.missing.values(), key=lambda one: _start(one.name.span))
    if not missing:
        return
    first, *others = missing
    declared = [_declared(one) for one in missing]
    names = listed(one.name.name for one in missing)
    message = f"there are no functions {names}" if others else f"there is no function {names}"
    each = "each, as in" if others else "it:"
    hint = f"declare {each} `{declared[0]}`; `koord migrate --stub` writes that"
    if first.near is not None:
        hint = f"{first.near} Else {hint}"
    notes = [Note(one.name.span, f"`{one.name.name}` is called here") for one in others]
    text = _STUBS + "".join(f"{line}\n" for line in declared)
    edits = (session.added(text),)
    session.findings.error("K202", first.name.span, message, hint, tuple(notes), edits)
    if not others:
        for place in first.places[1:]:
            session.findings.again("K202", first.name.span, place)


def _declared(one: MissingFunction) -> str:
    """A declaration of a function as it is called: its answers are any values of the type."""
    letters = (f"{show(type_)} a{place}" for place, type_ in enumerate(one.parameters, 1))
    kind = "extern" if one.is_fixed else "extern fresh"
    return f"def fun {one.name.name}({', '.join(letters)}) -> {show(one.result)}: {kind}"


def _start(span: Span) -> tuple[str, int, int]:
    return span.file, span.line, span.column


def confused(session: Elaboration) -> None:
    """Report allread variables whose entries were meant to be lists, each at its type."""
    for symbol in session.shared.values():
        if not isinstance(symbol, VariableSymbol):
            continue
        uses = [found for found in session.confusions if found.variable == symbol.variable]
        if uses:
            _confused(session, symbol, uses)


def _confused(session: Elaboration, symbol: VariableSymbol, uses: list[Confusion]) -> None:
    name = symbol.variable.name
    assert isinstance(symbol.variable.type, ArrayType)
    entry = show(symbol.variable.type.element)
    stored = [use for use in uses if use.stored] or uses
    verb = "is stored in" if stored[0].stored else "is wanted of"
    session.findings.error(
        "K244",
        symbol.type_span,
        f"`{name}` holds one `{entry}` for each robot, but a `{entry}[]` {verb} `{name}[pid]`",
        f"declare it as `{entry}[][] {name}`: one `{entry}[]` for each robot",
        tuple(
            Note(
                use.span,
                f"a `{entry}[]` is stored here" if use.stored else f"`{entry}[][]` is wanted here",
            )
            for use in sorted(uses, key=lambda use: (use.span.line, use.span.column))[:4]
        ),
    )


#: The fields that lead from a variable to a part of it; which element of an array is left open.
Path = tuple[int, ...]

#: Values to begin with.
_FIRST: tuple[tuple[Type, str], ...] = (
    (INT, "0"),
    (FLOAT, "0.0"),
    (BOOL, "false"),
    (STRING, '""'),
    (POS, "pos(0, 0, 0)"),
)

#: Types of great arrays of records are not taken apart further.
_MOST_PATHS = 1_000


def never_set(session: Elaboration, program: core.Program) -> None:
    """Warn of variables without a value that nothing sets, and something reads."""
    unset = [d for d in _declarations(program) if d[0].initial is core.Start.UNSET]
    if not unset:
        return
    reads: dict[Key, list[core.Place]] = {}
    sets: dict[Key, set[Path]] = {}
    for number, agent in enumerate(program.agents):
        for node in nodes((agent.init, agent.events)):
            for place in _read(node):
                reads.setdefault(key(place.variable, number), []).append(place)
            for path, place in _set(node):
                sets.setdefault(key(place.variable, number), set()).add(path)
    stated = [p.condition for p in (*program.properties, *program.expectations)]
    stated += [p.trigger for p in (*program.properties, *program.expectations) if p.trigger]
    for condition in stated:
        for place, kind in places_read(condition):
            for each in range(len(program.agents)) if kind is None else (kind,):
                reads.setdefault(key(place.variable, each), []).append(place)
    # Types of records of records are nowhere hashed: that takes as long as they have parts.
    told: set[Span] = set()
    for declaration, owner in unset:
        found = key(declaration.variable, owner)
        part = _unset(declaration, reads.get(found, ()), sets.get(found, set()))
        if part is not None and declaration.span not in told:
            told.add(declaration.span)
            _warn(session, declaration, part)


def _declarations(program: core.Program) -> Iterator[tuple[core.Declaration, int | None]]:
    for declaration in (*program.allread, *program.allwrite):
        yield declaration, None
    for kind, agent in enumerate(program.agents):
        for declaration in agent.locals:
            yield declaration, kind


def _read(node: object) -> Iterator[core.Place]:
    """The places that a node reads itself; changing a list reads it."""
    match node:
        case core.Read(place=place):
            yield place
        case core.Append(place=place) | core.Remove(place=place) | core.Pop(place=place):
            yield place
        case _:
            pass


def _set(node: object) -> Iterator[tuple[Path, core.Place]]:
    """Yield the places that a statement sets: not a list of which it changes an element."""
    changed = core.Append | core.Remove
    for place in () if isinstance(node, changed) else written(node):
        if isinstance(node, core.Pop) and place is node.place:
            continue
        path, whole = _path(place)
        if whole:
            yield path, place


def _path(place: core.Place) -> tuple[Path, bool]:
    """The fields on the way to a place, and whether it lies outside of lists and maps."""
    path: list[int] = []
    type_: Type = place.variable.type
    for step in place.steps:
        match step:
            case core.FieldStep(position=position):
                path.append(position)
            case core.IndexStep() if isinstance(type_, ArrayType):
                pass
            case core.IndexStep() | core.KeyStep():
                return tuple(path), False
            case _:
                assert_never(step)
        type_ = step.type
    return tuple(path), True


def _unset(
    declaration: core.Declaration, reads: Iterable[core.Place], sets: set[Path]
) -> Path | None:
    """A part of a variable that is read, and that nothing sets."""
    for place in reads:
        path, _ = _path(place)
        inner = _at(declaration.variable.type, path)
        for count, rest in enumerate(_atoms(inner)):
            if count == _MOST_PATHS:
                break
            atom = (*path, *rest)
            if not any(atom[:end] in sets for end in range(len(atom) + 1)):
                return atom
    return None


def _at(type_: Type, path: Path) -> Type:
    for position in path:
        type_ = _element(type_)
        assert isinstance(type_, RecordType)
        type_ = type_.fields[position][1]
    return _element(type_)


def _element(type_: Type) -> Type:
    while isinstance(type_, ArrayType):
        type_ = type_.element
    return type_


def _atoms(type_: Type) -> Iterator[Path]:
    """The parts of a value that are set separately."""
    type_ = _element(type_)
    if not isinstance(type_, RecordType):
        yield ()
        return
    for position, (_, field) in enumerate(type_.fields):
        for rest in _atoms(field):
            yield (position, *rest)


def _warn(session: Elaboration, declaration: core.Declaration, path: Path) -> None:
    variable = declaration.variable
    type_, fields = variable.type, []
    for position in path:
        type_ = _element(type_)
        assert isinstance(type_, RecordType)
        name, type_ = type_.fields[position]
        fields.append(name)
    part = f"`{'.'.join(fields)}` of `{variable.name}`" if fields else f"`{variable.name}`"
    own = variable.type
    if variable.home is core.Home.ALLREAD:
        assert isinstance(own, ArrayType)
        own = own.element
    first = _first(own)
    cure = "set it in `init:`"
    if first is not None:
        cure = f"begin with a value, as `{variable.name} = {first}`, or {cure}"
    if takes_tasks(variable):
        cure += "; or the configuration's `world: {tasks: …}` gives it one"
    session.findings.warning(
        "K406",
        declaration.span,
        f"{part} is read and never set: to read it is a fault",
        cure,
    )


def _first(type_: Type) -> str | None:
    """An initial value to suggest."""
    match type_:
        case GrowingType():
            return "[]"
        case MapType():
            return "{}"
        case EnumType(members=members):
            return members[0]
        case _:
            return next((text for known, text in _FIRST if type_ == known), None)
