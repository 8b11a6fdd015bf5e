"""Worst-case execution times: steps that the text bounds, and times that were measured here.

Steps are a bound for every run, of `koord.syntax.analysis.worst_paths`. The times are those of the
compiled program on this machine in sampled runs, by the clock of the processor: whether the worst
path was among them nobody knows.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from random import Random
from statistics import median
from typing import Any, TypeVar

from msgspec import Struct, field
from msgspec.structs import replace

from koord.refinement.running import ready, run
from koord.runtime.engine import Deployed
from koord.runtime.proposals import Proposal
from koord.runtime.robot import Forwarding, Host, Key, Robot, Turn
from koord.syntax.analysis.worst_paths import AgentPaths, worst_paths
from koord.syntax.analysis.worst_paths import EventPaths as EventPaths
from koord.syntax.system import System
from koord.traces.trace import Sources

#: Runs are sampled until so many turns were measured, or for so many seconds.
_TURNS, _SECONDS = 3_000, 2.0

#: A run has so many rounds at most, and so many are begun, for programs that end or fault at once.
_ROUNDS, _RUNS = 100, 100

R = TypeVar("R", bound=Robot)


class MeasuredTimes(Struct):
    """The times that turns took in which a robot ran the same event, in nanoseconds of CPU."""

    ns: list[int] = field(default_factory=list)

    @property
    def median_us(self) -> float | None:
        """The median in microseconds; None if there is no time."""
        return median(self.ns) / 1_000 if self.ns else None

    @property
    def longest_us(self) -> float | None:
        """The longest in microseconds; None if there is no time."""
        return max(self.ns) / 1_000 if self.ns else None


class ExecutionTimes(Struct, frozen=True):
    """Worst paths by kind of robot, and what turns took.

    That is by kind as well, then by the number of the event (None: of turns without one).
    """

    agents: tuple[AgentPaths, ...]
    measured: tuple[dict[int | None, MeasuredTimes], ...]

    @property
    def longest_us(self) -> float | None:
        """The longest turn that was measured, in microseconds; None if none was."""
        every = (one.longest_us for of_kind in self.measured for one in of_kind.values())
        return max(filter(None, every), default=None)


def execution_times(
    system: System, sources: Sources, seed: int, interrupted: Callable[[], bool] = lambda: False
) -> ExecutionTimes:
    """The worst paths of all events, and what turns take on this machine in sampled runs.

    Raises TooLargeError if the program is too large to be looked through.
    """
    paths = worst_paths(system)
    kinds = sorted(set(system.kinds))
    times: dict[int, dict[int | None, MeasuredTimes]] = {kind: {} for kind in kinds}
    left, until_s = _TURNS, time.monotonic() + _SECONDS

    def took(robot: Robot, proposal: Proposal, ns: int) -> None:
        nonlocal left
        left -= 1
        ran = proposal.attempts[0].event if proposal.attempts else None
        times[system.kinds[robot.pid]].setdefault(ran, MeasuredTimes()).ns.append(ns)

    def is_over() -> bool:
        return left <= 0 or time.monotonic() > until_s or interrupted()

    plain = ready(system.program)
    timed = replace(plain, classes=tuple(_timed(made, took) for made in plain.classes))
    for number in range(_RUNS):
        if is_over():
            break
        # A run for which no inputs are found ends: what was measured by then counts.
        rng = Random(f"{seed} {number}")
        run(timed, system, sources, Deployed(), _ROUNDS, rng, is_over=is_over)
    return ExecutionTimes(paths, tuple(times[kind] for kind in kinds))


class _TimedHost(Forwarding):
    """A host that knows how long it was asked in all: that is no time of the program."""

    asked_ns = 0

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        with self._timing():
            return super().ask(turn, robot, key, function, arguments)

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        with self._timing():
            return super().choose(turn, robot, key, low, high)

    @contextmanager
    def _timing(self) -> Iterator[None]:
        began = time.thread_time_ns()
        try:
            yield
        finally:
            self.asked_ns += time.thread_time_ns() - began


def _timed(made: type[R], took: Callable[[Robot, Proposal, int], None]) -> type[R]:
    """A class of robots that tell how long each of their program turns takes."""

    def begin(self: Any, pid: int, kinds: Sequence[int], delta_s: float, host: Host) -> None:
        made.__init__(self, pid, kinds, delta_s, _TimedHost(host))

    def propose(
        self: Any, round_: int, order: Iterable[int] | None = None, *, willing: bool = True
    ) -> Proposal:
        began = time.thread_time_ns() - self.host.asked_ns
        proposal: Proposal = made.propose(self, round_, order, willing=willing)
        took(self, proposal, time.thread_time_ns() - self.host.asked_ns - began)
        return proposal

    return type(made.__name__, (made,), {"__init__": begin, "propose": propose})
