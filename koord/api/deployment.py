"""Deployment: a program on one robot, or on processes of this machine for all robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike

from msgspec.structs import replace

from koord.api.breaches import grounds_of
from koord.api.deploy_followed import Deployment
from koord.api.deploy_request import NOT_RESTARTED, NOT_SHARED, DeployRequest, check_outputs
from koord.api.deploy_run import run_all, run_one
from koord.api.deploy_setup import job_of
from koord.api.deployed import Deployed
from koord.api.files import file_name
from koord.api.fitting import Configurable, Fitted, fit, fit_request
from koord.api.preflight import Approval, good_enough
from koord.api.programs import Loadable, Value
from koord.api.progress import MOST_JOBS, Cancellation, Listener, heard_by
from koord.api.results import ArgumentError
from koord.api.robots import Seconds
from koord.api.served_page import LIVE
from koord.runtime.deploy.job import CannotTakePartError, Job
from koord.runtime.transports.transport import TransportError
from koord.syntax.diagnostics import refusal


def deploy(
    program: Loadable,
    config: Configurable = None,
    *,
    pid: int | None = None,
    params: Mapping[str, Value] | None = None,
    delta_s: Seconds = None,
    rounds: int | None = None,
    as_fast_as_possible: bool = False,
    run: str | None = None,
    state: str | PathLike[str] | None = None,
    fresh: bool = False,
    record: str | PathLike[str] | None = None,
    restart: bool = False,
    trace: str | PathLike[str] | None = None,
    dry_run: bool = False,
    allow_models: Sequence[str] = (),
    arm: bool = False,
    approve: Approval | None = None,
    preflight: bool = False,
    rests_on: str | PathLike[str] | None = None,
    live: bool | tuple[str, int] = False,
    loss: float = 0.0,
    processes: int | None = None,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Deployed:
    """Run a program on the robot with this ``pid``, in this process; or on all robots.

    Without a ``pid`` each robot is a process on this machine. ``config`` is a configuration, or its
    file; else the file beside the program that has its name. The run ends after so many ``rounds``,
    when all robots have stopped, or on ``cancellation``: robots then stop safely. ``delta_s`` is
    the length of a round in seconds, instead of the configuration's. ``run`` is the name of the
    run, the same for all robots; ``state`` the folder of the robots' journals, with which a run
    goes on after crashes (with a ``pid``: ``.koord``), and ``fresh`` begins a new run all the same.
    What robots do is recorded in the file ``record``, as MCAP. ``restart`` (without a ``pid``):
    robots whose processes crash or are killed are started again, and go on where they were. The run
    ends where no round can be decided any more. What robots do is told in the file ``trace``: that
    of the run, judged by the rules (``merged`` of the result); with a ``pid`` the robot's part of
    it, for :func:`koord.merge`. With ``dry_run`` all vehicles are simulated, in real
    time; ``allow_models`` are ports (``Module.port``) that may be made up where nobody serves them.
    Vehicles stay where they are unless ``arm`` says that they may move. Before that robots look at
    themselves and each other: ``approve`` is asked a few times a second with what they have found
    (:class:`koord.api.preflight.Preflight`), until it answers True or False; without it they are
    armed if nothing is bad, and else refused. With ``preflight`` that is all that happens
    (``preflight`` of the result). The program's claims are
    watched while it runs: what did not hold is ``broken`` of the result, with the verdicts whose
    proofs need it if ``rests_on`` is the file of a report of :func:`koord.verify` that was made
    with ``rests_on``, as JSON. ``live`` serves a page of the run on this machine, or at an address
    and port, for everybody who can reach that. ``loss`` is the share of the arriving datagrams
    that are lost on purpose, to rehearse a bad network. So many ``processes`` share the robots of
    this machine, for large fleets; who is alone in a process is alone if it is killed.
    ``progress`` hears :class:`FleetHeard`.

    Raises :class:`koord.KoordError` for what is wrong with the input, or with the network.

    >>> koord.deploy(program, "task.yaml", rounds=100, dry_run=True).is_complete
    True
    """
    request = DeployRequest(
        pid=pid,
        rounds=rounds,
        as_fast_as_possible=as_fast_as_possible,
        run=run,
        state=file_name(state),
        fresh=fresh,
        record=file_name(record),
        restart=restart,
        trace=file_name(trace),
        dry_run=dry_run,
        allow_models=tuple(allow_models),
        arm=arm,
        preflight=preflight,
        rests_on=file_name(rests_on),
        live=(LIVE if live else None) if isinstance(live, bool) else live,
        loss=loss,
        processes=processes,
    )
    if restart and pid is not None:
        raise ArgumentError("restart", NOT_RESTARTED)
    if processes is not None and (pid is not None or not 1 <= processes <= MOST_JOBS):
        story = NOT_SHARED if pid is not None else f"must be from 1 to {MOST_JOBS}, not {processes}"
        raise ArgumentError("processes", story)
    check_outputs(request)
    wanted = fit_request(program, config, params, None, None, delta_s, located=not dry_run)
    fitted = fit(wanted)
    job = job_of(fitted, request)
    return deploy_fitted(fitted, job, request, progress, cancellation, approve=approve)


def deploy_fitted(
    fitted: Fitted,
    job: Job,
    request: DeployRequest,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
    *,
    approve: Approval | None = None,
) -> Deployed:
    """As :func:`deploy`, for a prepared run. Raises KoordError."""
    if request.preflight:
        request = replace(request, record=None, trace=None, live=None)
    grounds = None
    if request.rests_on is not None:
        grounds = grounds_of(request.rests_on, fitted.program)
    tell, approve = heard_by(progress), approve or good_enough
    deployment = Deployment(fitted, job, request, tell, cancellation, grounds, approve)
    try:
        deployed = run_all(deployment) if request.pid is None else run_one(deployment, request.pid)
    except TransportError as error:
        raise refusal("K933", job.configuration.name, error.message, error.hint or None) from None
    except CannotTakePartError as error:
        where = error.file or job.configuration.name
        raise refusal("K939", where, error.message, error.hint) from None
    return replace(deployed, warnings=fitted.warnings + job.warnings)
