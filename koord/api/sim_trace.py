"""Simulated runs as traces of the semantics, and judging them."""

from __future__ import annotations

from msgspec.structs import replace

from koord.api.fitting import Fitted
from koord.api.sim_setup import slack
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
    """Writes a run down while it goes on.

    Vehicles keep contracts with slack, and so the rules that judge them have it, too.
    """

    def __init__(self, fitted: Fitted) -> None:
        """Raises KoordError where the program is too much for the reference."""
        self.program, self.slack = fitted.program, slack(fitted)
        core = fitted.program.core
        found = excesses(core, fitted.kinds)
        if found:
            raise KoordError(found)
        self.system = System(loosened(core, self.slack), fitted.kinds, fitted.delta_s)
        self._made = ready(core)
        self._hearing: TracedFleet | None = None

    def hear(self, host: Host, world: Host) -> Host:
        """The host that a run is to have instead of another, of a ``world``."""
        self._hearing = TracedFleet(self._made, self.system, host, world)
        return self._hearing

    @property
    def is_begun(self) -> bool:
        """Whether INIT is over."""
        return self._hearing is not None and self._hearing.is_begun

    def begun(self, decision: Decision, simulation: Simulation) -> None:
        """INIT is over."""
        assert self._hearing is not None
        self._hearing.begun(decision, simulation.engine)

    def round(self, decision: Decision, simulation: Simulation) -> None:
        """A round is over."""
        assert self._hearing is not None
        self._hearing.round(decision, simulation.engine)

    def ran(self, simulation: Simulation) -> CompiledRun:
        """The run, as far as it got. Raises KoordError."""
        assert self._hearing is not None
        sources = sources_of(self.program)
        return self._hearing.ran(simulation.engine, sources, self._shapes(simulation))

    def so_far(self, simulation: Simulation) -> Trace:
        """The trace of a run that goes on, up to the last round that is over. Raises KoordError."""
        assert self._hearing is not None
        sources = sources_of(self.program)
        heard = self._hearing.so_far(simulation.engine, sources, self._shapes(simulation))
        return self._as_written(heard)

    def judged(self, ran: CompiledRun) -> Judged:
        """What the reference says of a run."""
        return judge(ran)

    def trace(self, ran: CompiledRun) -> Trace:
        """The trace of a run, of the program as it is written, and with the slack that it had."""
        return self._as_written(ran.trace)

    def _as_written(self, trace: Trace) -> Trace:
        system = replace(self.system, program=self.program.core)
        return replace(trace, system=system, slack=self.slack)

    @staticmethod
    def _shapes(simulation: Simulation) -> dict[str, Shape]:
        """Those of the answers that are asked for in a simulation and by no robot."""
        watches = simulation.host.watches
        return {name: shape for one in watches for name, shape in one.EXTERNALS.items()}
