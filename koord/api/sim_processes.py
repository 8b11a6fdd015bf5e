"""Simulated runs with a process for each robot, over UDP, in real time."""

from __future__ import annotations

import secrets
import time
from collections.abc import Iterator
from contextlib import ExitStack

from msgspec import Struct
from msgspec.structs import replace

from koord.api.deployed import Deployed, FleetHeard
from koord.api.fitting import Fitted
from koord.api.outputs import growing
from koord.api.progress import Cancellation, Listener, asker, heard_by
from koord.api.sim_report import Processes, Simulated, SimulationBegun, report_of, setup_of
from koord.api.sim_run import SimulationRequest, conclude
from koord.api.sim_setup import cast, fallback, limit_s, simulation
from koord.api.sim_trace import Tracing
from koord.runtime.deploy.job import Job as Deployment
from koord.runtime.deploy.local import Launch, LocalProcesses, launched, local_plan
from koord.runtime.proposals import Decision
from koord.runtime.transports.transport import TransportError
from koord.sim.processes import Followed, RobotMaker
from koord.sim.running import Ending
from koord.syntax.diagnostics import refusal

#: How long processes are waited for at a time.
_WAIT_S = 0.2

#: In a run without a pace no time passes while somebody plans: nobody is to be late for that.
_UNHURRIED_S = 5.0


def simulate_processes(
    fitted: Fitted,
    request: SimulationRequest,
    tracing: Tracing | None,
    progress: Listener | None,
    cancellation: Cancellation | None,
) -> Simulated:
    """Run the robots, each in a process, and follow their reports. Raises KoordError."""
    followed = simulation(
        fitted,
        Followed,
        keep_going=request.keep_going,
        check_summaries=request.check_summaries,
        tracing=None if tracing is None else tracing.hear,
    )
    setup, made, tell = setup_of(fitted), cast(fitted), heard_by(progress)
    delta_s, pace = fitted.scene.delta_s, request.outputs.speed
    deployment = Deployment(
        made.classes,
        fitted.kinds,
        fitted.configuration,
        secrets.token_bytes(32),
        f"sim {secrets.token_hex(4)}",
        delta_s=delta_s,
        pace_s=0.0 if pace is None else delta_s / pace,
        rounds=round(limit_s(fitted, request.rounds, request.duration_s) / delta_s),
        journals=None,
        unhurried_s=_UNHURRIED_S,
    )
    tell(SimulationBegun("the run begins", setup=setup))
    began = time.perf_counter()
    try:
        # What is told keeps the pace of the processes by itself.
        with (
            growing(request.outputs, followed, tracing, tell, paced=False) as round_is_over,
            ExitStack() as stack,
        ):
            maker = RobotMaker(made, fitted.scene, fallback(fitted))
            plan = local_plan(deployment.configuration, deployment.robots)
            fleet = launched(Launch(deployment, plan, maker, keeps_rounds=True))
            stack.callback(fleet.join)
            stack.callback(fleet.kill)
            follower = _Follower(fleet, deployment, followed, tell, cancellation)
            for decision in follower.rounds():
                if tracing is not None:
                    tracing.heard(decision, followed)
                round_is_over(followed.time_s)
            died = fleet.died
    except TransportError as error:
        hint = error.hint or None
        raise refusal("K933", fitted.configuration.name, error.message, hint) from None
    wall_s = time.perf_counter() - began
    ended = Deployed.of(deployment, setup.problem, fleet.statuses, interrupted=False)
    processes = Processes(ended, follower.late, died)
    simulated = replace(report_of(fitted, setup, followed, wall_s), processes=processes)
    return conclude(simulated, followed, request.outputs, tracing, tell)


class _Follower(Struct):
    """The reconstruction of a run's rounds from its processes' reports.

    ``late`` is how many proposals came too late for their rounds, of those that were told of.
    """

    fleet: LocalProcesses
    deployment: Deployment
    followed: Followed
    tell: Listener
    cancellation: Cancellation | None
    late: int = 0

    def rounds(self) -> Iterator[Decision]:
        """Yield all rounds, until the run is over. Raises TransportError."""
        fleet, followed, is_cancelled = self.fleet, self.followed, asker(self.cancellation)
        is_stopped = False
        self.tell(FleetHeard.of({}, self.deployment.rounds))
        while not fleet.is_over:
            for news in fleet.news(_WAIT_S):
                self.late += sum(one.late for one in news.rounds)
                followed.hear(news.rounds)
            yield from followed.rounds()
            self.tell(FleetHeard.of(fleet.statuses, self.deployment.rounds))
            # Of a robot whose process has died nothing more is told: the run is known up to here.
            is_known = followed.ending is None and not fleet.died
            if not is_stopped and (is_cancelled() or not is_known):
                is_stopped = True
                fleet.stop()
            fleet.check()
        yield from followed.rounds(is_over=True)
        if followed.ending is None:
            followed.end(self._ending(is_interrupted=is_cancelled()))

    def _ending(self, *, is_interrupted: bool) -> Ending:
        if is_interrupted:
            return Ending.INTERRUPTED
        limit = self.deployment.rounds
        is_whole = limit is not None and self.followed.engine.round >= limit
        return Ending.LIMIT if is_whole else Ending.SILENT
