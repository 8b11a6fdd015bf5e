"""Two runs of one program: by compiled robots, and by machine code where it is sure of them."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from koord.runtime.columns.engine import ColumnEngine
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.compile.machine.layout import KNOWN, Leaf
from koord.runtime.compile.machine.lazy import LazyTurns
from koord.runtime.engine import Deployed, RoundEngine, Schedule
from koord.runtime.proposals import Decision
from koord.runtime.robot import Key, Robot, Turn
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.load import load
from koord.syntax.source import Source


class PlainHost:
    """A host whose sensors read what a function says of the robot and the round."""

    def __init__(self, reading: Callable[[int, int], Mapping[str, Any]]) -> None:
        self.reading = reading
        self.round = 0

    def start(self, robot: int | None, name: str) -> Any:
        return self.reading(robot or 0, 0)[name]

    def read(self, robot: Robot) -> Mapping[str, Any]:
        self.round += robot.pid == 0
        return self.reading(robot.pid, self.round)

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        return len(function) + robot

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        return low


def program_of(text: str) -> core.Program:
    loaded = load(Source("twins.krd", text))
    assert loaded.program is not None, loaded.diagnostics
    return loaded.program


def told(decision: Decision, engine: RoundEngine) -> str:
    """All that is to be alike, to the last bit."""
    robots = [(vars(r), r.status, r.ran, r.had_an_event) for r in engine.robots]
    of = decision.ran, decision.skipped, decision.fault
    return repr((of, robots, engine.store.values, engine.ended, engine.shown))


def twins(
    text: str,
    robots: int,
    rounds: int,
    reading: Callable[[int, int], Mapping[str, Any]] = lambda robot, round_: {},
    schedules: Callable[[], Schedule] = Deployed,
) -> ColumnEngine:
    """Run a program by both, and compare them after each round; return the one by code."""
    program = program_of(text)
    classes = loaded(compiled(program))
    kinds = core.round_robin(robots, len(program.agents))
    one = RoundEngine(classes, kinds, 0.1, PlainHost(reading))
    other = ColumnEngine(classes, kinds, 0.1, PlainHost(reading), LazyTurns(program), after=0)
    plain, by_code = schedules(), schedules()
    one.begin()
    other.begin()
    for _ in range(rounds):
        if one.ended is not None or one.all_stopped:
            break
        found = told(one.program_turns(plain), one), told(other.program_turns(by_code), other)
        if found[0] != found[1]:  # asserting it would show them, which takes long
            at = next(k for k, (a, b) in enumerate(zip(*found, strict=False)) if a != b)
            pytest.fail(f"{found[0][at - 60 : at + 60]} | {found[1][at - 60 : at + 60]}")
        check_columns(other)
        if one.ended is None:
            one.environment_turn()
            other.environment_turn()
            check_columns(other)
    assert one.all_stopped == other.all_stopped
    return other


def check_columns(engine: ColumnEngine) -> None:
    """Check that columns hold what robots hold, bit by bit."""
    fleet = engine.fleet
    if fleet is None or engine.ended is not None:
        return
    for column in fleet.turns.layout.columns.values():
        for robot in engine.robots:
            if column.kind not in (None, robot.KIND):
                continue
            held = vars(robot)[column.name]
            if column.name in engine.store.values:
                shared = engine.store.values[column.name]
                held = shared[robot.pid] if column.home is Home.ALLREAD else shared
            for number, (leaf, part) in enumerate(
                zip(column.leaves, column.flatten(held), strict=True)
            ):
                word, flags = fleet.columns.seen(column, number, robot.pid)
                if flags & KNOWN:
                    if leaf is Leaf.FLOAT:
                        (part,) = struct.unpack("q", struct.pack("d", part))
                    assert word == int(part), (column.name, robot.pid)
                else:
                    is_nan = leaf is Leaf.FLOAT and part != part
                    assert part is None or is_nan or not -(2**63) <= part < 2**63
