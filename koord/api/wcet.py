"""Worst-case execution times: steps that the text bounds, and times that were measured here.

Steps are a bound for every run, of `koord.syntax.analysis.worst_paths`. The times are those of the
compiled program on this machine in sampled runs, by the clock of the processor: whether the worst
path was among them nobody knows.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from random import Random
from statistics import median
from typing import Any, TypeVar

from msgspec import Struct, field

from koord.refinement.running import ready
from koord.refinement.sampling_hosts import SampledHost
from koord.refinement.translation import Translation
from koord.runtime.engine import Deployed, RoundEngine
from koord.runtime.proposals import INIT_ROUND, Proposal
from koord.runtime.robot import Key, Robot, Turn
from koord.sampling.sampled_inputs import SampledInputs
from koord.sampling.values import Sampler
from koord.syntax.analysis.worst_paths import AgentPaths, worst_paths
from koord.syntax.analysis.worst_paths import EventPaths as EventPaths
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.traces.trace import Numbers

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
    system: System, seed: int, interrupted: Callable[[], bool] = lambda: False
) -> ExecutionTimes:
    """The worst paths of all events, and what turns take on this machine in sampled runs.

    Raises TooLargeError if the program is too large to be looked through.
    """
    paths = worst_paths(system)
    kinds = sorted(set(system.kinds))
    times: dict[int, dict[int | None, MeasuredTimes]] = {kind: {} for kind in kinds}

    def took(robot: Robot, proposal: Proposal, ns: int) -> None:
        ran = proposal.attempts[0].event if proposal.attempts else None
        times[system.kinds[robot.pid]].setdefault(ran, MeasuredTimes()).ns.append(ns)

    made = ready(system.program)
    classes = [_timed(made_class, took) for made_class in made.classes]
    left, until_s = _TURNS, time.monotonic() + _SECONDS

    def is_over() -> bool:
        return left <= 0 or time.monotonic() > until_s or interrupted()

    for number in range(_RUNS):
        if is_over():
            break
        rng = Random(f"{seed} {number}")
        host = _TimedHost(
            Translation(system, made.names),
            SampledInputs(Sampler(system, Numbers.DOUBLE, rng)),
        )
        fleet = RoundEngine(classes, system.kinds, float(system.delta_s), host)
        try:
            for _ in islice(_rounds(fleet, host), _ROUNDS):
                left -= system.robots
                if is_over():
                    break
        except KoordError:  # no inputs are found that suit: what was measured counts
            continue
    return ExecutionTimes(paths, tuple(times[kind] for kind in kinds))


def _rounds(fleet: RoundEngine, host: SampledHost) -> Iterator[None]:
    """Run a fleet to its end, round by round."""
    inputs, schedule = host.inputs, Deployed()
    order = schedule.order(INIT_ROUND, host.system.robots)
    host.settle_start(order)
    fleet.begin(order)
    while fleet.ended is None and not fleet.all_stopped:
        inputs.forget_round()
        inputs.look_at(host.translation.configuration(fleet))
        if fleet.program_turns(schedule).fault is None:
            host.settle_readings(host.translation.configuration(fleet))
            fleet.environment_turn()
        yield


class _TimedHost(SampledHost):
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

    def propose(
        self: Any, round_: int, order: Iterable[int] | None = None, *, willing: bool = True
    ) -> Proposal:
        began = time.thread_time_ns() - self.host.asked_ns
        proposal: Proposal = made.propose(self, round_, order, willing=willing)
        took(self, proposal, time.thread_time_ns() - self.host.asked_ns - began)
        return proposal

    return type(made.__name__, (made,), {"propose": propose})
