"""Runs as data: the schedule and every value that the rules leave open. [RECORDING]

A recording and a system determine a run, see :mod:`koord.semantics.execution`.
"""

from __future__ import annotations

from typing import TypeAlias

from msgspec import Struct

from koord.semantics.domain import Constant
from koord.semantics.oracle import Key, Phase
from koord.semantics.values import Value
from koord.syntax.core import Home

Concrete: TypeAlias = "Value[Constant]"


class Answer(Struct, frozen=True):
    """What one ``choose`` (``function`` is None) or one external call gave, and to whom."""

    phase: Phase
    robot: int
    key: Key
    function: str | None
    arguments: tuple[Concrete, ...]
    value: Concrete


class Start(Struct, frozen=True):
    """What an arbitrary variable started with; ``robot`` is None for allwrite variables."""

    home: Home
    slot: int
    robot: int | None
    value: Concrete


class Reading(Struct, frozen=True):
    """What a sensor without a model read after a round."""

    robot: int
    slot: int
    value: Concrete


class Opening(Struct, frozen=True):
    """All that INIT leaves open."""

    order: tuple[int, ...]
    starts: tuple[Start, ...] = ()
    answers: tuple[Answer, ...] = ()


class Round(Struct, frozen=True):
    """All that one round leaves open.

    ``order`` is the order of the robots' program turns; ``events[i]`` the position of the event
    that robot i ran, None where it skipped. A round that is ``cut`` ends before the environment's
    turn (a violation inside the round, a fault); its order may lack robots.
    """

    order: tuple[int, ...]
    events: tuple[int | None, ...]
    readings: tuple[Reading, ...] = ()
    answers: tuple[Answer, ...] = ()
    cut: bool = False


class Recording(Struct, frozen=True):
    """A run from INIT on. Of a lasso, the rounds from number ``loop`` on repeat for ever."""

    opening: Opening
    rounds: tuple[Round, ...] = ()
    loop: int | None = None
