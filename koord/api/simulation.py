"""Simulation: a program in a simulated world."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from os import PathLike, fspath

from msgspec.structs import replace

from koord.api.files import file_name, read_written
from koord.api.fitting import Configurable, Fitted, fit, fit_request
from koord.api.outputs import Outputs, View
from koord.api.programs import Loadable, Program, Value, source_of
from koord.api.progress import Cancellation, Listener
from koord.api.results import ArgumentError
from koord.api.robots import Seconds
from koord.api.sim_report import Simulated
from koord.api.sim_run import SimulationRequest, play
from koord.api.sim_setup import simulation
from koord.sim.running import Simulation
from koord.syntax.collector import uncollected as uncollected


@uncollected()
def simulate(
    program: Loadable,
    config: Configurable = None,
    *,
    params: Mapping[str, Value] | None = None,
    robots: int | None = None,
    seed: int | None = None,
    delta_s: Seconds = None,
    rounds: int | None = None,
    duration_s: float | None = None,
    keep_going: bool = False,
    check_summaries: bool = False,
    processes: bool = False,
    kernels: bool = True,
    planners: int = 0,
    schedule: str | PathLike[str] | None = None,
    html: str | PathLike[str] | None = None,
    view: View = "2d",
    record: str | PathLike[str] | Iterable[str | PathLike[str]] = (),
    plot: str | PathLike[str] | None = None,
    trace: str | PathLike[str] | None = None,
    live: bool = False,
    pace: float | None = None,
    reload: bool = False,
    ask: bool = False,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Simulated:
    """Run a program in a simulated world.

    ``config`` is a configuration, or its file; else the file beside the program that has its name,
    else the plainest that suits. ``robots``, ``seed`` and ``delta_s`` (the length of a round in
    seconds) replace those of the configuration. The run ends after so many ``rounds``, or so much
    simulated time: 600 s, 120 s if the program cannot stop. It ends where a claim is broken, unless
    it is to ``keep_going``. ``check_summaries`` holds every answer of an external function against
    the summary that is verified with. With ``processes`` programs are in as many processes as
    there are cores, which changes no run; with a ``pace`` who is late skips. Long runs go over to
    machine code, which does the same, but not if ``kernels`` is False. So many processes as
    ``planners`` says look for robots' ways meanwhile, which changes no run.
    ``schedule`` is a trace, such as a counterexample, that is played instead.

    Files are written where they are named: ``html`` (a page that shows the run, from above or, with
    ``view="3d"``, in space), ``record`` (``.mcap``, ``.rrd``, ``.rosbag2``), ``plot`` (``.png``,
    ``.svg``, ``.pdf``), ``trace``. ``live`` serves the page while the run goes on, ``pace`` times
    as quickly as time goes by; ``progress`` hears of its address as ``PageServed``. With
    ``reload`` it goes on with the edited program whenever its file is saved, and ends when it is
    cancelled, unless a limit is given; ``progress`` hears of it as ``ProgramReloaded``. If it is to
    ``ask``, an edit that drops values is taken when it is saved again as it is.

    Raises :class:`koord.KoordError` for what is wrong with the input.

    >>> koord.simulate(program, "task.yaml", seed=1, duration_s=60).broken
    ()
    """
    paths = (record,) if isinstance(record, str | PathLike) else tuple(record)
    outputs = Outputs(
        html=file_name(html),
        view=view,
        record=tuple(fspath(one) for one in paths),
        plot=file_name(plot),
        trace=file_name(trace),
        live=live,
        pace=pace,
    )
    outputs.check()
    request = SimulationRequest(
        rounds,
        duration_s,
        keep_going,
        check_summaries,
        processes,
        outputs,
        kernels,
        planners,
        reload,
        ask=ask,
    )
    request.check()
    if schedule is None:
        asked = fit_request(program, config, params, robots, seed, delta_s)
        if reload:
            from koord.api.edits import FileEdits

            files = [one.name for one in (asked.source, *asked.properties)]
            with FileEdits(asked, files) as edits:
                request = replace(request, edits=edits)
                return simulate_fitted(fit(asked), request, progress, cancellation)
        return simulate_fitted(fit(asked), request, progress, cancellation)
    given = (config, params, robots, seed, delta_s, trace)
    if processes or planners or reload or ask or any(one is not None for one in given):
        story = "a recorded run is played as it is: only its end and its outputs can be chosen"
        raise ArgumentError("schedule", story)
    from koord.api.rehearsal import rehearse

    source = program.source if isinstance(program, Program) else source_of(program)
    name = fspath(schedule)
    return rehearse(source, read_written(name), name, request, progress, cancellation)


def simulate_fitted(
    fitted: Fitted,
    request: SimulationRequest,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Simulated:
    """As :func:`simulate`, for a fitted program. Raises KoordError."""
    tracing = None
    if request.outputs.trace is not None:
        from koord.api.sim_trace import Tracing

        tracing = Tracing(fitted)
    if request.processes:
        from koord.api.sim_processes import simulate_processes

        return simulate_processes(fitted, request, tracing, progress, cancellation)
    made = simulation(
        fitted,
        Simulation,
        keep_going=request.keep_going,
        check_summaries=request.check_summaries,
        tracing=None if tracing is None else tracing.hear,
        kernels=request.kernels,
    )
    made.fleet.plan_with(request.planners)
    return play(fitted, made, request, tracing, progress, cancellation)
