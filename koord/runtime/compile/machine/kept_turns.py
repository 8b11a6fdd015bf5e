"""Machine code of programs that was kept: what is told of it, and how it is found again.

What is told are columns, events and claims by their places in the program; the program itself is
here whenever its code is looked for, and is what the key is made of.
"""

from __future__ import annotations

import msgspec
from msgspec import Struct

from koord.machine.kept import Compiled, find, key_of
from koord.runtime.compile.machine.layout import Column, Layout
from koord.runtime.compile.machine.made import (
    HEAD_WORDS,
    MORE_OF_CLAIMS,
    MORE_OF_TURNS,
    STATE_WORDS,
    ClaimCode,
    Effect,
    KindTurns,
    Turns,
)
from koord.runtime.compile.naming import PythonNames
from koord.runtime.compile.watching import Watched
from koord.syntax import core
from koord.syntax.core import Home


class ToldColumn(Struct, frozen=True, array_like=True):
    """A variable: of robots of which kind, or of all; where it lives, and its slot there."""

    whose: int | None
    home: str
    slot: int


class ToldKind(Struct, frozen=True, array_like=True):
    """Events of a kind: numbers of the columns that each may write, None without code of it.

    And bits of guards without any.
    """

    events: tuple[tuple[int, ...] | None, ...]
    without: int


class ToldClaim(Struct, frozen=True, array_like=True):
    """A look at a claim: the function's name, and the kinds of robots."""

    function: str
    kinds: tuple[int, ...]


class ToldTurns(Struct, frozen=True):
    """All that is told of the machine code of a program."""

    columns: tuple[ToldColumn, ...]
    kinds: tuple[ToldKind | None, ...]
    claims: dict[str, tuple[ToldClaim, ...]]


def key_of_turns(program: core.Program, watched: Watched | None) -> str | None:
    """The key of the machine code of a program and of its claims. Places in texts do not count."""
    claims: tuple[object, ...] = ()
    if watched is not None:
        stated = [(c.sort.value, c.method, repr(c.agents), c.stated) for c in watched.claims]
        claims = (repr(watched.program), *stated)
    return key_of("turns", repr(program), claims)


def kept_turns(program: core.Program, watched: Watched | None, key: str | None) -> Turns | None:
    """The machine code of a program that is kept under its key; None if none can be used."""
    found = find(key)
    if found is None:
        return None
    try:
        told = msgspec.json.decode(found.about, type=ToldTurns)
    except msgspec.DecodeError:
        return None
    return assembled(program, watched, told, found.code)


def assembled(
    program: core.Program, watched: Watched | None, told: ToldTurns, code: Compiled
) -> Turns:
    """The machine code of a program, of what is told of it and of the functions."""
    layout = Layout(PythonNames(program))
    columns = [
        layout.column(one.whose or 0, _variable(program, one.whose or 0, Home(one.home), one.slot))
        for one in told.columns
    ]
    kinds = tuple(
        None if one is None else _kind(program.agents[number], number, one, columns, code)
        for number, one in enumerate(told.kinds)
    )
    claims = {
        method: tuple(
            ClaimCode(code.function(one.function, STATE_WORDS + MORE_OF_CLAIMS), one.kinds)
            for one in looks
        )
        for method, looks in told.claims.items()
    }
    return Turns(layout, kinds, watched, claims)


def _kind(
    agent: core.Agent, number: int, told: ToldKind, columns: list[Column], code: Compiled
) -> KindTurns:
    count = STATE_WORDS + MORE_OF_TURNS
    effects: list[Effect | None] = []
    for position, event in enumerate(told.events):
        if event is None:
            effects.append(None)
            continue
        written = tuple(columns[column] for column in event)
        words = HEAD_WORDS + sum(len(column.leaves) for column in written)
        run = code.function(f"run_{number}_{position}", count)
        effects.append(Effect(run, written, words))
    urgent = sum(1 << k for k, event in enumerate(agent.events) if event.urgent)
    guards = code.function(f"guards_{number}", count)
    return KindTurns(guards, tuple(effects), urgent, told.without)


def _variable(program: core.Program, kind: int, home: Home, slot: int) -> core.Variable:
    agent = program.agents[kind]
    match home:
        case Home.LOCAL:
            declared = agent.locals
        case Home.PORT:
            declared = tuple(port.declaration for port in agent.ports)
        case Home.ALLREAD:
            declared = program.allread
        case _:
            declared = program.allwrite
    return next(one.variable for one in declared if one.variable.slot == slot)
