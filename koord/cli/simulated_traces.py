"""Simulated runs as traces of the semantics: ``koord sim --trace``, and judging them."""

from __future__ import annotations

from dataclasses import replace

from koord.cli.simulating import Job
from koord.cli.traces import sources_of
from koord.refinement.hearing import Hearing
from koord.refinement.judging import Judged, judge
from koord.refinement.running import Ran, ready
from koord.runtime.compile.slack import loosened
from koord.runtime.proposals import Decision
from koord.runtime.robot import Host
from koord.semantics.configurations import System
from koord.semantics.traces.trace import Trace
from koord.sim.running import Simulation
from koord.syntax.costs import excesses
from koord.syntax.diagnostics import KoordError


class Tracing:
    """Writes a run down while it goes on.

    Vehicles keep contracts with slack, and so the rules that judge them have it, too.
    """

    def __init__(self, job: Job) -> None:
        """Raises KoordError where the program is too much for the reference."""
        self.job = job
        program = job.loaded.program
        found = excesses(program, job.kinds)
        if found:
            raise KoordError(found)
        delta_s = job.delta_s
        self.system = System(loosened(program, job.slack), job.kinds, delta_s)
        self._made = ready(program)
        self._hearing: Hearing | None = None

    def hear(self, host: Host) -> Host:
        """The host that a run is to have instead of another."""
        self._hearing = Hearing(self._made, self.system, host)
        return self._hearing

    def begun(self, decision: Decision, simulation: Simulation) -> None:
        """INIT is over."""
        assert self._hearing is not None
        self._hearing.begun(decision, simulation.engine)

    def round(self, decision: Decision, simulation: Simulation) -> None:
        """A round is over."""
        assert self._hearing is not None
        self._hearing.round(decision, simulation.engine)

    def ran(self, simulation: Simulation) -> Ran:
        """The run, as far as it got. Raises KoordError."""
        assert self._hearing is not None
        shapes = {
            name: shape for one in simulation.host.watches for name, shape in one.EXTERNALS.items()
        }
        return self._hearing.ran(simulation.engine, sources_of(self.job.loaded), shapes)

    def judged(self, ran: Ran) -> Judged:
        """What the reference says of a run."""
        return judge(ran)

    def trace(self, ran: Ran) -> Trace:
        """The trace of a run, of the program as it is written, and with the slack that it had."""
        system = replace(self.system, program=self.job.loaded.program)
        return replace(ran.trace, system=system, slack=self.job.slack)
