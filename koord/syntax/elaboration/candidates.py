"""Candidates: what could stand in a hole, where an editor's cursor is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from koord.syntax.elaboration.body import (
    CLOSED,
    SEES_PORTS,
    SEES_VARIABLES,
    BodyScope,
    Where,
)
from koord.syntax.elaboration.recorder import (
    Candidate,
    EventSymbol,
    FieldSymbol,
    Hole,
    HoleKind,
    KindSymbol,
    Meaning,
    ModuleSymbol,
    OwnName,
    TypeSymbol,
)
from koord.syntax.elaboration.symbols import (
    BoundSymbol,
    MemberSymbol,
    ModuleScope,
    ParamSymbol,
    PortSymbol,
    Signature,
    VariableSymbol,
)
from koord.syntax.types import FLOAT, INT, EnumType, RecordType, SequenceType, Type


def fill(body: BodyScope, expected: Type | None, *, is_statement: bool = False) -> None:
    """Note what could stand in a hole for a value, or for the first word of a statement."""
    kind = HoleKind.STATEMENT if is_statement else HoleKind.VALUE
    _fill(body, kind, _visible(body), expected)


def fill_types(body: BodyScope, names: Iterable[str]) -> None:
    """Note the types that could stand in a hole."""
    named = body.session.types.named
    found = (Candidate(name, TypeSymbol(name, named.get(name))) for name in names)
    _fill(body, HoleKind.TYPE, found)


def fill_part(body: BodyScope, owner: Type) -> None:
    """Note the fields or operations that a hole behind a dot could name."""
    _fill(body, HoleKind.PART, _parts(owner))


def fill_owned(body: BodyScope, owner: str, module: ModuleScope | None) -> None:
    """Note the ports of a module, or the members of an enumeration, that a hole could name."""
    type_ = body.session.types.named.get(owner)
    found = list[Candidate]()
    if isinstance(type_, EnumType):
        members = (m for name in type_.members for m in body.session.member(name))
        found += (_of(m.declared.name, m) for m in members if m.type == type_)
    known = {} if module is None else module.ports
    found += (_of(name, port) for name, port in known.items())
    others = body.session.library_ports.get(owner, frozenset()) - known.keys()
    found += (Candidate(name, ModuleSymbol(owner)) for name in sorted(others))
    _fill(body, HoleKind.PART, found)


def fill_events(body: BodyScope) -> None:
    """Note the events that a hole in ``ran`` could name."""
    names = dict.fromkeys(name for agent in body.session.agents for name in agent.events)
    _fill(body, HoleKind.EVENT, (Candidate(name, EventSymbol(name)) for name in names))


def _fill(
    body: BodyScope, kind: HoleKind, found: Iterable[Candidate], expected: Type | None = None
) -> None:
    recorder = body.session.recorder
    if recorder is not None:
        recorder.hole = Hole(kind, tuple(found), expected, body.where)


def _of(name: str, meaning: Meaning) -> Candidate:
    type_: Type | None = None
    match meaning:
        case VariableSymbol(variable=variable) | PortSymbol(variable=variable):
            type_ = variable.type
        case BoundSymbol(variable=bound):
            type_ = None if bound is None else bound.type
        case MemberSymbol(type=enum):
            type_ = enum
        case ParamSymbol(value=value):
            type_ = None if value is None else value.type
        case Signature(result=result):
            type_ = result
        case _:
            pass
    return Candidate(name, meaning, type_)


def _parts(owner: Type) -> Iterator[Candidate]:
    match owner:
        case RecordType(fields=fields):
            for position, (name, type_) in enumerate(fields):
                yield Candidate(name, FieldSymbol(owner, position), type_)
        case SequenceType():
            for name in ("append", "contains", "length", "max", "min", "pop", "remove"):
                yield Candidate(name, OwnName(name))
        case _ if owner.parts:  # of maps and sets
            for name in ("add", "contains", "keys", "length", "remove"):
                yield Candidate(name, OwnName(name))
        case _:
            pass


def _visible(body: BodyScope) -> Iterator[Candidate]:
    """The names that have a meaning here, the inner ones first."""
    session = body.session
    seen = set[str]()
    for name, meaning in _named(body):
        if name not in seen:
            seen.add(name)
            yield _of(name, meaning)
    if body.where is not Where.CONSTANT:
        for name in ("numAgents", "delta"):
            yield Candidate(name, OwnName(name), INT if name == "numAgents" else FLOAT)
    if body.where not in (Where.CONSTANT, Where.FUNCTION):
        yield Candidate("pid", OwnName("pid"), INT)
    for name, record in session.types.records.items():
        yield Candidate(name, TypeSymbol(name, record.type), record.type)
    for agent in session.agents:
        if agent.name and body.where in CLOSED:
            yield Candidate(agent.name, KindSymbol(agent.name))


def _named(body: BodyScope) -> Iterator[tuple[str, Meaning]]:
    session = body.session
    for frame in reversed(body.frames):
        yield from frame.items()
    sees_variables = body.where in SEES_VARIABLES
    agents = session.agents if body.agent is None else [body.agent]
    for agent in agents:
        if sees_variables:
            yield from agent.variables.items()
        if body.where in SEES_PORTS:
            for name, ports in agent.ports.items():
                own = [port for port in ports if getattr(port, "module", "") == body.module]
                if own or body.module is None:
                    yield name, (own or ports)[0]
            for name in agent.modules:
                yield name, ModuleSymbol(name)
    for name, symbol in session.shared.items():
        if sees_variables or isinstance(symbol, ParamSymbol):
            yield name, symbol
    for name, members in session.types.members.items():
        yield name, members[0]
    yield from session.functions.own.items()
