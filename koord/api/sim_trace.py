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
from koord.sim.running import Simulation
from koord.syntax.analysis.limits import excesses
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.traces.trace import Trace


class Tracing:
    """A tracer of a run in progress.

    Vehicles keep contracts with slack, and so the rules that judge them have it, too.
    """

    def __init__(self, fitted: Fitted) -> None:
        """Make a tracer. Raises KoordError where the program is too large for the reference."""
        self.program, self.slack = fitted.program, slack_of(fitted)
        core = fitted.program.core
        found = excesses(core, fitted.kinds)
        if found:
            raise KoordError(found)
        self.system = System(loosened(core, self.slack), fitted.kinds, fitted.delta_s)
        self._made = ready(core)
        self._hearing: TracedFleet | None = None

    def hear(self, host: Host, world: Host) -> Host:
        """Wrap a host of a ``world``, to record its answers."""
        self._hearing = TracedFleet(self._made, self.system, host, world)
        return self._hearing

    @property
    def is_begun(self) -> bool:
        """True if INIT is over."""
        return self._hearing is not None and self._hearing.is_begun

    def heard(self, decision: Decision, simulation: Simulation) -> None:
        """Record the end of INIT or of a round."""
        assert self._hearing is not None
        self._hearing.heard(decision, simulation.engine)

    def ran(self, simulation: Simulation) -> CompiledRun:
        """The run so far. Raises KoordError."""
        assert self._hearing is not None
        sources = sources_of(self.program)
        return self._hearing.ran(simulation.engine, sources, self._shapes(simulation))

    def so_far(self, simulation: Simulation) -> Trace:
        """The trace of a run in progress, up to the last finished round. Raises KoordError."""
        assert self._hearing is not None
        sources = sources_of(self.program)
        heard = self._hearing.so_far(simulation.engine, sources, self._shapes(simulation))
        return self._as_written(heard)

    def judged(self, ran: CompiledRun) -> Judged:
        """Judge a run by the reference."""
        return judge(ran)

    def trace(self, ran: CompiledRun) -> Trace:
        """The trace of a run, with the program as written and its slack."""
        return self._as_written(ran.trace)

    def _as_written(self, trace: Trace) -> Trace:
        system = replace(self.system, program=self.program.core)
        return replace(trace, system=system, slack=self.slack)

    @staticmethod
    def _shapes(simulation: Simulation) -> dict[str, Shape]:
        """The shapes of answers that only the simulation asks for."""
        watches = simulation.host.watches
        return {name: shape for one in watches for name, shape in one.EXTERNALS.items()}
