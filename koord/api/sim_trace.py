"""Tracing of simulated runs, and their judgement by the semantics."""

from __future__ import annotations

from msgspec.structs import replace

from koord.api.fitting import Fitted, slack_of
from koord.api.traces import sources_of
from koord.refinement.judging import Judged, judge
from koord.refinement.running import CompiledRun, ready
from koord.refinement.tracing_host import TracedFleet
from koord.runtime.compile.slack import loosened
from koord.runtime.proposals import Decision
from koord.runtime.robot import Host
from koord.runtime.shapes import Shape
from koord.semantics.recordings import Reached
from koord.sim.running import Simulation
from koord.syntax.analysis.limits import excesses
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.traces.trace import Trace


def system_of(fitted: Fitted) -> System:
    """The system of a fitted program, as its vehicles keep it."""
    program = loosened(fitted.program.core, slack_of(fitted))
    return System(program, fitted.kinds, fitted.delta_s)


class TracedProgram:
    """A program of a run, with what hears its host.

    Vehicles keep contracts with slack, and so the rules that judge them have it, too.
    """

    def __init__(self, fitted: Fitted, before: Reached | None = None) -> None:
        """Trace a program; one that goes on from ``before``, if that is given. [RELOAD]

        Raises KoordError where the program is too large for the reference.
        """
        self.program, self.slack = fitted.program, slack_of(fitted)
        core = fitted.program.core
        found = excesses(core, fitted.kinds)
        if found:
            raise KoordError(found)
        self.system = system_of(fitted)
        self._made, self._before = ready(core), before
        self.fleet: TracedFleet | None = None

    def hear(self, host: Host, world: Host) -> Host:
        """Wrap a host of a ``world``, to record its answers."""
        self.fleet = TracedFleet(self._made, self.system, host, world, self._before)
        return self.fleet

    def ran(self, simulation: Simulation) -> CompiledRun:
        """What the program has run so far. Raises KoordError."""
        assert self.fleet is not None
        return self.fleet.ran(simulation.engine, sources_of(self.program), shapes_of(simulation))

    def so_far(self, simulation: Simulation) -> Trace:
        """The same up to the last finished round. Raises KoordError."""
        assert self.fleet is not None
        return self.fleet.so_far(simulation.engine, sources_of(self.program), shapes_of(simulation))


class Tracing:
    """A tracer of a run in progress: of its program, or of one after the other."""

    def __init__(self, fitted: Fitted) -> None:
        """Make a tracer. Raises KoordError where the program is too large for the reference."""
        self._now = TracedProgram(fitted)
        self._earlier: list[tuple[TracedProgram, Trace]] = []

    def hear(self, host: Host, world: Host) -> Host:
        """Wrap a host of a ``world``, to record its answers."""
        return self._now.hear(host, world)

    @property
    def is_begun(self) -> bool:
        """True if INIT is over."""
        return self._now.fleet is not None and self._now.fleet.is_begun

    def heard(self, decision: Decision, simulation: Simulation) -> None:
        """Record the end of INIT or of a round."""
        assert self._now.fleet is not None
        self._now.fleet.heard(decision, simulation.engine)

    def finished(self, simulation: Simulation) -> Trace:
        """The trace of the program that runs, which is to end here. Raises KoordError."""
        return self._now.ran(simulation).trace

    def go_on(self, program: TracedProgram, finished: Trace, simulation: Simulation) -> None:
        """Record that another program goes on. [RELOAD]"""
        assert program.fleet is not None
        self._earlier.append((self._now, finished))
        self._now = program
        program.fleet.resumed(simulation.engine)

    def ran(self, simulation: Simulation) -> CompiledRun:
        """The run so far. Raises KoordError."""
        ran = self._now.ran(simulation)
        return replace(ran, trace=self._whole(ran.trace))

    def so_far(self, simulation: Simulation) -> Trace:
        """The trace of a run in progress, up to the last finished round. Raises KoordError."""
        return self._as_written(self._whole(self._now.so_far(simulation)))

    def judged(self, ran: CompiledRun) -> Judged:
        """Judge a run by the reference."""
        return judge(ran)

    def trace(self, ran: CompiledRun) -> Trace:
        """The trace of a run, with its programs as written and their slack."""
        return self._as_written(ran.trace)

    def _as_written(self, trace: Trace) -> Trace:
        programs = [*(program for program, _ in self._earlier), self._now]
        first, *later = [
            replace(
                part,
                system=replace(program.system, program=program.program.core),
                slack=program.slack,
            )
            for program, part in zip(programs, trace.parts, strict=True)
        ]
        return replace(first, later=tuple(later))

    def _whole(self, last: Trace) -> Trace:
        first, *later = [*(trace for _, trace in self._earlier), last]
        return replace(first, later=tuple(later))


def shapes_of(simulation: Simulation) -> dict[str, Shape]:
    """The shapes of answers that only the simulation asks for."""
    watches = simulation.host.watches
    return {name: shape for one in watches for name, shape in one.EXTERNALS.items()}
