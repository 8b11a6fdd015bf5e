"""Simulated runs with programs in processes of their own."""

from __future__ import annotations

from contextlib import closing
from functools import partial

from koord.api.fitting import Fitted
from koord.api.progress import Cancellation, Listener, cores
from koord.api.sim_report import Simulated
from koord.api.sim_run import SimulationRequest, play
from koord.api.sim_setup import simulation
from koord.api.sim_trace import Tracing
from koord.sim.groups import GroupedSimulation


def simulate_processes(
    fitted: Fitted,
    request: SimulationRequest,
    tracing: Tracing | None,
    progress: Listener | None,
    cancellation: Cancellation | None,
) -> Simulated:
    """Run a simulation with programs in as many processes as there are cores. Raises KoordError."""
    pace = request.outputs.speed
    patience_s = None if pace is None else fitted.scene.delta_s / pace
    made = simulation(
        fitted,
        partial(GroupedSimulation, processes=cores(), patience_s=patience_s),
        keep_going=request.keep_going,
        check_summaries=request.check_summaries,
        tracing=None if tracing is None else tracing.hear,
        kernels=request.kernels,
    )
    with closing(made):
        made.fleet.plan_with(request.planners)
        return play(fitted, made, request, tracing, progress, cancellation)
