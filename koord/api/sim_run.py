"""A simulation from INIT to its end: reported, judged and kept."""

from __future__ import annotations

import math
import time
from functools import partial
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from koord.api.fitting import Fitted
from koord.api.growing import remove_part
from koord.api.outputs import Outputs, growing, keep
from koord.api.progress import MOST_JOBS, Cancellation, Listener, asker, heard_by
from koord.api.results import ArgumentError
from koord.api.sim_report import (
    Simulated,
    SimulationBegun,
    SimulationOver,
    StandsStill,
    report_of,
    round_over,
    setup_of,
    standing_words,
)
from koord.api.sim_setup import check_begun, limit_s, next_program
from koord.api.traces import ITF_SUFFIX
from koord.sim.running import Ending, Simulation, run

if TYPE_CHECKING:
    from koord.api.edits import Edits
    from koord.api.sim_trace import Tracing

#: More robots that stand still are not told of while a run goes on.
_MOST_TOLD = 24


class SimulationRequest(Struct, frozen=True):
    """The request for a simulation: limits, and outputs to keep. None: as suits the program."""

    rounds: int | None = None
    duration_s: float | None = None
    keep_going: bool = False
    check_summaries: bool = False
    processes: bool = False
    outputs: Outputs = Outputs()
    kernels: bool = True
    planners: int = 0  #: so many processes plan meanwhile
    reload: bool = False  #: go on with edits of the program
    edits: Edits | None = None  #: where these come from
    ask: bool = False  #: take those that drop values when they are saved a second time

    def check(self) -> None:
        """Check what does not hang on the program. Raises ArgumentError."""
        if self.reload:
            self._check_reload()
        elif self.ask:
            raise ArgumentError("ask", "only edits are asked about: say `reload=`")
        if not 0 <= self.planners <= MOST_JOBS:
            raise ArgumentError("planners", f"must be from 0 to {MOST_JOBS}, not {self.planners}")

    def _check_reload(self) -> None:
        if not self.outputs.live:
            raise ArgumentError("reload", "only runs that are looked at take edits: say `live=`")
        if self.processes:
            raise ArgumentError("reload", "edits are taken in one process: leave out `processes=`")
        if self.outputs.trace is not None and self.outputs.trace.endswith(ITF_SUFFIX):
            raise ArgumentError("reload", f"{ITF_SUFFIX} has one program: say another `trace=`")

    def limit_s(self, fitted: Fitted) -> float:
        """When the run ends in simulated seconds; one that takes edits, if nobody says, never."""
        if self.edits is not None and self.rounds is None and self.duration_s is None:
            return math.inf
        return limit_s(fitted, self.rounds, self.duration_s)


def play(
    fitted: Fitted,
    simulation: Simulation,
    request: SimulationRequest,
    tracing: Tracing | None,
    progress: Listener | None,
    cancellation: Cancellation | None,
) -> Simulated:
    """Run a simulation from INIT to its end. Raises KoordError where it may not begin so."""
    tell, is_cancelled = heard_by(progress), asker(cancellation)
    limit = request.limit_s(fitted)
    began = time.perf_counter()
    if request.outputs.live or request.outputs.pace is not None:
        simulation.striding = None  # somebody looks at each round when it is over
    first = simulation.begin()
    if tracing is not None:
        tracing.heard(first, simulation)
    check_begun(fitted, simulation)
    setup = setup_of(fitted)
    reloading = None
    if request.edits is not None:
        from koord.api.reloading import Reloading

        make = partial(
            next_program, check_summaries=request.check_summaries, kernels=request.kernels
        )
        reloading = Reloading(
            fitted, simulation, request.edits, make, tell, tracing, asks=request.ask
        )
    tell(SimulationBegun("the run begins", setup=setup, processes=len(simulation.groups)))
    with growing(request.outputs, simulation, tracing, tell) as round_is_over:
        told = 0
        if reloading is not None:
            reloading.between_rounds()
        for decision in run(simulation, limit):
            tell(round_over(simulation))
            if tracing is not None:
                tracing.heard(decision, simulation)
            round_is_over(simulation.time_s)
            for one in simulation.noticed[told:_MOST_TOLD]:
                tell(StandsStill(standing_words(one), standing=one))
            told = len(simulation.noticed)
            if reloading is not None:
                reloading.between_rounds()
            if is_cancelled():
                simulation.end(Ending.INTERRUPTED)
    simulated = report_of(fitted, setup, simulation, time.perf_counter() - began)
    return conclude(simulated, simulation, request.outputs, tracing, tell)


def conclude(
    simulated: Simulated,
    simulation: Simulation,
    outputs: Outputs,
    tracing: Tracing | None,
    tell: Listener,
) -> Simulated:
    """Judge and keep a finished run. Raises KoordError where a file cannot be written."""
    if tracing is not None:
        from koord.api.traces import complete_trace

        assert outputs.trace is not None
        ran = tracing.ran(simulation)
        complete_trace(outputs.trace, tracing.trace(ran))
        remove_part(outputs.trace)
        simulated = replace(simulated, refused=tracing.judged(ran).refused)
    tell(SimulationOver(simulated.ending.value, simulated=simulated))
    return replace(simulated, kept=keep(outputs, simulation.recording))
