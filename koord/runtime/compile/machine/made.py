"""The machine code of a program's turns, as data: whoever has it need not make it."""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct, field

from koord.runtime.compile.machine.layout import Column, Layout
from koord.runtime.compile.watching import Watched

#: What a turn says: no, or done; yes; in doubt.
NO, YES, IN_DOUBT = 0, 1, 2

#: What every function is given first: rows and cells, their flags, the number of robots, δ.
STATE_WORDS = 6

#: What guards and events are given behind it, and what claims are.
MORE_OF_TURNS, MORE_OF_CLAIMS = 5, 6

#: Before the cells of what an event writes: its locks, and whether it asks to stop.
HEAD_WORDS = 2


class Effect(Struct, frozen=True, eq=False):
    """The machine code of an event: what it may write, and the words that it takes a robot.

    ``run`` is given the state, numbers of robots, how many, and the addresses of words, flags and
    verdicts of each of these.
    """

    run: Callable[..., int]
    columns: tuple[Column, ...]
    words: int


class KindTurns(Struct, frozen=True, eq=False):
    """The machine code of a kind of robots.

    ``guards`` is given the state, numbers of robots, how many, and the addresses of two words for
    every robot of the fleet: bits of the events that are enabled, and of those that it is in doubt
    of; then that of the numbers of robots that have any such bit, and it says how many these are.
    Of events without an effect in code it says whether they are enabled all the same.
    """

    guards: Callable[..., int]
    effects: tuple[Effect | None, ...]
    urgent: int  #: bits of urgent events
    without: int  #: bits of events whose guards have no code, which are in doubt at any time


class ClaimCode(Struct, frozen=True, eq=False):
    """The machine code of a claim about robots of some kinds: of none, one or two robots.

    ``run`` is given the state; numbers of robots for the first, how many, and the same for the
    second; the address of pairs of words, and how many have room there. It writes down the robots
    of which it is not sure that the claim holds, and says how many these are; if they are more than
    have room, it says so and no more of them. Where there is no such robot a list has one element.
    """

    run: Callable[..., int]
    kinds: tuple[int, ...]


class Turns(Struct, frozen=True, eq=False):
    """The machine code of a program's turns. None of a kind for which there is no use of it.

    And of the claims of ``watched``, by method; they have code for all kinds that they are about,
    or none.
    """

    layout: Layout
    kinds: tuple[KindTurns | None, ...]
    watched: Watched | None = None
    claims: dict[str, tuple[ClaimCode, ...]] = field(default_factory=dict)
