"""``koord deploy FILE CONFIG``: run a program on a robot, or on processes for all of them."""

from __future__ import annotations

import argparse
import sys
from argparse import ArgumentTypeError
from importlib.util import find_spec
from ipaddress import ip_address

from koord.api.deploy_request import NOT_RESTARTED, NOT_SHARED, NOT_TWICE, DeployRequest
from koord.api.deploy_setup import Job, job_of
from koord.api.deployed import Deployed, FleetHeard
from koord.api.deployment import deploy_fitted
from koord.api.files import same_file
from koord.api.fitting import Fitted
from koord.api.progress import Progress
from koord.api.served_page import LIVE, PageServed
from koord.cli.arguments import (
    add_files,
    add_json,
    add_settings,
    add_site,
    check_files,
    delta,
    processes,
    read_by,
    rounds,
)
from koord.cli.deployed import Board, summary
from koord.cli.diagnostics import DiagnosticReport, report_error
from koord.cli.exits import Exit
from koord.cli.files import check_writable
from koord.cli.fitting import fit_request, fitted
from koord.cli.merged import left_lines, merge_lines, refusal_code
from koord.cli.preflight import Question, check_answerable, show_preflight
from koord.cli.progress import Interruption
from koord.cli.remote import add_ssh, check_ssh, print_unit, run_over_ssh
from koord.cli.terminal import visible
from koord.syntax.diagnostics import KoordError


def configure(parser: argparse.ArgumentParser) -> None:
    add_files(parser, several=False)
    parser.add_argument("config", metavar="CONFIG", help="the configuration of the run (.yaml)")
    add_site(parser)
    parser.add_argument("--pid", metavar="I", type=int, help="run the robot with this pid")
    parser.add_argument(
        "--all-local", action="store_true", help="run all robots, as processes on this machine"
    )
    add_ssh(parser)
    parser.add_argument(
        "--rounds", metavar="R", type=rounds, help="end after so many rounds (go on until Ctrl-C)"
    )
    parser.add_argument(
        "--delta",
        metavar="SECONDS",
        type=delta,
        help="the length of a round, instead of the configuration's",
    )
    parser.add_argument(
        "--as-fast-as-possible", action="store_true", help="begin each round when the last is over"
    )
    parser.add_argument("--run", metavar="NAME", help="the name of the run, the same for all")
    parser.add_argument(
        "--state",
        metavar="DIR",
        help="the folder of robots' journals, with which a run goes on after crashes "
        "(with --pid: .koord)",
    )
    parser.add_argument(
        "--fresh", action="store_true", help="begin a new run, whatever journals say"
    )
    parser.add_argument(
        "--restart",
        action="store_true",
        help="start robots again whose processes crash or are killed (with --all-local)",
    )
    parser.add_argument(
        "--processes",
        metavar="N",
        type=processes,
        help="so many processes share the robots of --all-local, as suits large fleets (one each)",
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="simulate all vehicles, in real time"
    )
    parser.add_argument(
        "--arm", action="store_true", help="let vehicles move: without, they stay where they are"
    )
    parser.add_argument(
        "--yes",
        action="store_true",
        help="with --arm: answer in advance the question that is asked after the preflight",
    )
    parser.add_argument(
        "--preflight",
        action="store_true",
        help="look at all robots, show what is found, move nothing, and end (exit code 0 or 1)",
    )
    parser.add_argument(
        "--allow-model",
        metavar="PORT",
        action="append",
        default=[],
        help="let a port be made up that no driver serves, as Module.port; may be given several "
        "times",
    )
    parser.add_argument(
        "--rests-on",
        metavar="FILE",
        help="what `koord verify --rests-on --json` printed: say which verdicts rest on a claim "
        "that does not hold",
    )
    parser.add_argument(
        "--live",
        metavar="ADDRESS:PORT",
        nargs="?",
        type=address,
        const=LIVE,
        help="serve a page of the run: on this machine alone, or where everybody sees it who can "
        "reach that address",
    )
    parser.add_argument(
        "--lose",
        metavar="SHARE",
        type=share,
        default=0.0,
        help="lose so much of what arrives, from 0 to 1, to rehearse a bad network",
    )
    parser.add_argument("--record", metavar="FILE", help="record what robots do, as MCAP")
    parser.add_argument(
        "--trace",
        metavar="FILE",
        help="write the trace of the run, for `koord replay`; with --pid the robot's part of it, "
        "for `koord merge`",
    )
    add_settings(parser)
    add_json(parser, "how each robot ended")
    parser.epilog = (
        "exit codes: 0 the rounds were done, or all robots have stopped, 1 a fault ended the run "
        "or a claim did not hold or its trace is not legal, "
        "2 errors in the input, or what may not be armed, 3 robots stopped before all rounds were "
        "done or the trace lacks some, or their processes ended, 130 stopped with Ctrl-C, "
        "143 by SIGTERM, 129 by SIGHUP (robots stop safely; a second one stops at once). What "
        "robots tell is in FILE.parts, beside the trace or the recording, until that is made: of a "
        "run that is killed it is left there, and `koord merge FILE.parts/*.jsonl` makes the trace"
    )


def main(arguments: argparse.Namespace) -> int:
    read = read_by(arguments)
    check_files(read)
    if [arguments.all_local, arguments.pid is not None, arguments.ssh].count(True) != 1:
        raise ArgumentTypeError(
            "say --pid I for one robot, or --all-local for all of them on this machine, "
            "or --ssh for all of them on their own computers"
        )
    check_ssh(arguments)
    if arguments.systemd:
        return print_unit(arguments, request_of(arguments))
    check_answerable(arguments)
    if arguments.restart and arguments.pid is not None:
        raise ArgumentTypeError(f"--restart: {NOT_RESTARTED}")
    if arguments.processes is not None and not arguments.all_local:
        raise ArgumentTypeError(f"--processes: {NOT_SHARED}")
    if arguments.trace is not None:
        check_writable(arguments.trace, read)
    if arguments.record is not None:
        check_writable(arguments.record, read)
        if arguments.trace is not None and same_file(arguments.record, arguments.trace):
            raise ArgumentTypeError(f"--record: {NOT_TWICE}")
        if find_spec("mcap") is None:
            raise ArgumentTypeError("--record needs the MCAP library: pip install 'koord[record]'")
    request = request_of(arguments)
    if arguments.ssh:
        return _end(arguments, run_over_ssh(arguments, request))
    report = DiagnosticReport()
    prepared = prepare(arguments, request, report)
    report.print(sys.stderr, as_json=False)
    if prepared is None:
        return Exit.BAD_INPUT
    found, job = prepared
    if not arguments.json:
        print(visible(str(found.problem)), flush=True)
    question = Question(answer=True if arguments.yes else None)
    with Interruption(patient=True) as interruption, Board(waits=job.waits) as board:

        def show(told: Progress) -> None:
            if isinstance(told, FleetHeard):
                board.is_stopping = interruption.requested
                board.show(told)
            elif isinstance(told, PageServed):
                board.announce(told.message)
            else:
                board.say(told.message)

        deployed = deploy_fitted(found, job, request, show, interruption, approve=question.ask)
    return _end(arguments, deployed)


def _end(arguments: argparse.Namespace, deployed: Deployed | None) -> int:
    """Print what came of a run, and return the exit code; None: its errors were printed."""
    if deployed is None:
        return Exit.BAD_INPUT
    if deployed.preflight is not None and not deployed.interrupted:
        return show_preflight(deployed.preflight, as_json=arguments.json)
    print(deployed.to_json() if arguments.json else summary(deployed))
    if deployed.merged is not None and not arguments.json:
        for line in merge_lines(arguments.trace, deployed.merged):
            print(line)
    if not arguments.json:
        for line in left_lines(deployed):
            print(line)
    if deployed.unmerged:
        report_error(KoordError(deployed.unmerged), as_json=False)
    return _ended(deployed)


def request_of(arguments: argparse.Namespace) -> DeployRequest:
    """The request that flags make."""
    return DeployRequest(
        pid=arguments.pid,
        rounds=arguments.rounds,
        as_fast_as_possible=arguments.as_fast_as_possible,
        run=arguments.run,
        state=arguments.state,
        fresh=arguments.fresh,
        record=arguments.record,
        restart=arguments.restart,
        trace=arguments.trace,
        dry_run=arguments.dry_run,
        allow_models=tuple(arguments.allow_model),
        arm=arguments.arm and not arguments.preflight,
        preflight=arguments.preflight,
        rests_on=arguments.rests_on,
        live=arguments.live,
        loss=arguments.lose,
        processes=arguments.processes,
    )


def share(text: str) -> float:
    """A number from 0 to 1, which is less. Raises ArgumentTypeError."""
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not 0 <= number < 1:
        raise ArgumentTypeError(f"{text!r} is no share: a number from 0 to less than 1")
    return number


def address(text: str) -> tuple[str, int]:
    """An address and a port as one argument: ``0.0.0.0:8000``. Raises ArgumentTypeError."""
    host, colon, port = text.rpartition(":")
    try:
        ip_address(host)
        number = int(port)
    except ValueError:
        number = -1
    if not colon or not 0 <= number < 65_536:
        raise ArgumentTypeError(f"{text!r} is no address with a port, such as 0.0.0.0:8000")
    return host, number


def prepare(
    arguments: argparse.Namespace, request: DeployRequest, report: DiagnosticReport
) -> tuple[Fitted, Job] | None:
    """Prepare the run as its robots know it; diagnostics go to the report."""
    wanted = fit_request(arguments, report, located=not request.dry_run)
    found = None if wanted is None else fitted(wanted, report)
    if found is None:
        return None
    try:
        job = job_of(found, request)
    except KoordError as error:
        report.add(error.diagnostics)
        return None
    report.add(job.warnings)
    return found, job


def _ended(deployed: Deployed) -> int:
    merged, unmerged = deployed.merged, deployed.unmerged
    is_wrong = bool(deployed.broken) or (merged is not None and merged.is_wrong)
    if deployed.in_trouble or is_wrong or (unmerged and refusal_code(unmerged) is Exit.VIOLATED):
        return Exit.VIOLATED
    if deployed.interrupted:
        return Exit.INTERRUPTED
    if not deployed.is_complete:
        return Exit.UNKNOWN
    if unmerged:
        return Exit.BAD_INPUT
    return Exit.OK if merged is None or merged.is_whole else Exit.UNKNOWN
