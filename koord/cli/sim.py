"""``koord sim FILE [CONFIG]``: run a program in a simulated world, and tell what it came to."""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

from koord.api.outputs import PLOTS, RECORDS, Outputs
from koord.cli.arguments import (
    add_files,
    add_json,
    add_settings,
    add_site,
    add_trace,
    check_files,
    delta,
    jobs,
    pace,
    particles,
    planners,
    read_by,
    rounds,
    runs,
    seconds,
    seed,
    sweep,
    until,
)
from koord.cli.diagnostics import DiagnosticReport
from koord.cli.exits import Exit
from koord.cli.files import DASH, read_program, read_written
from koord.cli.terminal import visible

if TYPE_CHECKING:
    from koord.api.sim_report import Simulated
    from koord.api.sim_run import SimulationRequest

#: Where the page goes if nobody says.
_PAGE = "run.html"

#: What stands for no page: no file has this name.
_NO_PAGE = ""


def configure(parser: argparse.ArgumentParser) -> None:
    add_files(parser, several=False)
    parser.add_argument(
        "config",
        metavar="CONFIG",
        nargs="?",
        help="the configuration of the run (.yaml); else the one beside the program, if there is "
        "one of its name",
    )
    add_site(parser)
    parser.add_argument(
        "--scene",
        metavar="FILE",
        help="where robots begin, as a scene of the published simulator says (.yml); without "
        "CONFIG, who they are, too",
    )
    parser.add_argument(
        "--robots",
        metavar="N",
        type=_robots,
        help="how many robots, instead of the configuration's",
    )
    parser.add_argument(
        "--seed", metavar="S", type=seed, help="what every random choice hangs on (0)"
    )
    parser.add_argument("--rounds", metavar="R", type=rounds, help="end after so many rounds")
    parser.add_argument(
        "--time",
        metavar="SECONDS",
        type=seconds,
        help="end after so much simulated time (600; 120 if the program cannot stop)",
    )
    parser.add_argument(
        "--delta", metavar="SECONDS", type=delta, help="of a round, instead of the configuration's"
    )
    parser.add_argument(
        "--keep-going", action="store_true", help="count what is broken, instead of ending there"
    )
    parser.add_argument(
        "--check-summaries",
        action="store_true",
        help="hold every answer of an external function against the summary that is verified with",
    )
    add_trace(parser, "the run")
    _add_outputs(parser)
    parser.add_argument(
        "--processes",
        action="store_true",
        help="programs in as many processes as there are cores; the run is the same, but with "
        "--pace who is late skips",
    )
    parser.add_argument(
        "--kernels",
        choices=("on", "off"),
        default="on",
        help="whether programs of long runs go over to machine code (koord[fast]), which does the "
        "same more quickly (on)",
    )
    parser.add_argument(
        "--planners",
        metavar="N",
        type=planners,
        default=0,
        help="so many processes look for robots' ways meanwhile; the run is the same (0)",
    )
    parser.add_argument(
        "--schedule",
        metavar="TRACE",
        help="play the run in a trace, such as a counterexample of `koord verify --trace`",
    )
    parser.add_argument(
        "--runs", metavar="K", type=runs, help="a campaign: so many runs, each with its own seed"
    )
    parser.add_argument(
        "--jobs", metavar="J", type=jobs, default=1, help="so many of them at a time (1)"
    )
    parser.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help="make the runs on a Dask cluster, as tcp://host:8786 (koord[cluster]); workers have "
        "one thread each",
    )
    parser.add_argument(
        "--sweep",
        metavar="NAME=VALUES",
        type=sweep,
        help="so many runs for each value of a param or of `robots`: robots=2..8, speed=0.5,1",
    )
    parser.add_argument(
        "--until",
        metavar="NAME=REACH",
        type=until,
        help="end the runs of a value as soon as the 95 %% interval of time, distance, waited, or "
        "broken (the rate of runs in which a claim was) reaches no further than so much to each "
        "side; --runs are the most (1000)",
    )
    parser.add_argument(
        "--csv",
        metavar="FILE",
        help="a line of figures for each of several runs, written as the run ends",
    )
    parser.add_argument(
        "--parquet",
        metavar="FILE",
        help="the same as a table for data frames, written anew every few seconds",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on with a campaign that was ended: runs that stand in the --csv or --parquet file "
        "are not made again",
    )
    parser.add_argument(
        "--splitting",
        metavar="CLAIM",
        help="in which share of runs a claim is broken (an invariant or contract by its name, "
        "separation, or fault), however rare that is: runs that come close to it are gone on with "
        "by other chance; --runs K is how often that is repeated (20)",
    )
    parser.add_argument(
        "--level",
        metavar="EXPR",
        help="a number that goes up as a run comes closer to breaking it, or a comparison that "
        "holds less and less; else the claim's own comparisons of numbers say it",
    )
    parser.add_argument(
        "--particles",
        metavar="N",
        type=particles,
        help="so many runs in each repetition of splitting (100)",
    )
    add_settings(parser)
    add_json(parser, "what the run came to")
    parser.epilog = (
        "exit codes: 0 done, 1 something was broken, or a fault ended the run, "
        "2 errors in the input, 5 a robot stands still that is to go somewhere, "
        "130 stopped with Ctrl-C"
    )


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    """Add the flags of outputs."""
    parser.add_argument(
        "--html",
        metavar="FILE",
        help=f"where the page goes that shows the run; it loads nothing from elsewhere ({_PAGE})",
    )
    parser.add_argument(
        "--no-html", dest="html", action="store_const", const=_NO_PAGE, help="make no page"
    )
    parser.add_argument(
        "--view",
        choices=("2d", "3d"),
        default="2d",
        help="what the page shows: the world from above with timeline and variables, or the "
        "robots in space (2d)",
    )
    parser.add_argument(
        "--live",
        action="store_true",
        help="serve the page on this machine while the run goes on, which then takes as long as "
        "it would",
    )
    parser.add_argument(
        "--reload",
        action="store_true",
        help="with --live: go on with the edited program at the next round whenever its file is "
        "saved; the run ends with Ctrl-C, unless --rounds or --time say when",
    )
    parser.add_argument(
        "--ask",
        action="store_true",
        help="with --reload: an edit that would drop values is told of, and taken when its file is "
        "saved again as it is",
    )
    parser.add_argument(
        "--pace",
        metavar="FACTOR",
        type=pace,
        help="let time pass at most so many times as quickly as on the wall (with --live 1, else "
        "without limit)",
    )
    parser.add_argument(
        "--record",
        metavar="FILE",
        type=_record,
        action="append",
        default=[],
        help="record the run for other tools, in the form that FILE ends in: "
        f"{', '.join(RECORDS)} (a rosbag2 folder); may be given several times",
    )
    parser.add_argument(
        "--plot",
        metavar="FILE",
        type=_picture,
        help="draw positions against time, and how a map grew, to a file that ends in "
        f"{', '.join(PLOTS)}",
    )


def _robots(text: str) -> int:
    from koord.api.robots import MOST_ROBOTS

    if not text.isascii() or not text.isdigit() or not 1 <= int(text[:9]) <= MOST_ROBOTS:
        raise argparse.ArgumentTypeError(f"robots must be from 1 to {MOST_ROBOTS}, not {text!r}")
    return int(text)


def _record(text: str) -> str:
    return _of_a_form(text, RECORDS)


def _picture(text: str) -> str:
    return _of_a_form(text, PLOTS)


def _of_a_form(text: str, endings: tuple[str, ...]) -> str:
    if Path(text).suffix.lower() not in endings:
        raise argparse.ArgumentTypeError(f"{text!r} ends in none of {', '.join(endings)}")
    return text


def main(arguments: argparse.Namespace) -> int:
    # What simulating needs is loaded here: `koord sim --help` is as light as any other.
    from koord.api.simulation import simulate_fitted, uncollected
    from koord.cli.fitting import fit_request, fitted
    from koord.cli.simulated import Shown

    _check_unsplit(arguments)
    if arguments.schedule is not None:
        return _rehearse(arguments)
    check_files([*read_by(arguments), *filter(None, [arguments.scene])])
    is_split = arguments.splitting is not None
    is_campaign = any(x is not None for x in (arguments.runs, arguments.sweep, arguments.until))
    is_campaign |= is_split
    request = _request(arguments)
    request.check()
    if is_split:
        from koord.cli.splitting import splitting, splitting_request

        split = splitting_request(arguments)
    elif is_campaign:
        from koord.cli.campaigns import campaign, campaign_request

        many = campaign_request(arguments)
    else:
        _check_single(arguments)
        request.outputs.check()
        if arguments.reload and DASH in _watched(arguments):
            raise argparse.ArgumentTypeError("--reload needs files; standard input cannot change")
    report = DiagnosticReport()
    with nullcontext() if is_campaign else uncollected():  # many runs leave cycles behind
        wanted = fit_request(
            arguments, report, arguments.robots, arguments.seed, scene=arguments.scene
        )
        found = None if wanted is None else fitted(wanted, report)
        out = sys.stdout if report.errors and arguments.json else sys.stderr
        report.print(out, as_json=arguments.json and out is sys.stdout)
        if wanted is None or found is None:
            return Exit.BAD_INPUT
        if is_split:
            return splitting(arguments, wanted, split, found.scene.seed)
        if is_campaign:
            return campaign(arguments, wanted, many, found.scene.seed)
        with ExitStack() as stack:
            if arguments.reload:
                from koord.api.edits import FileEdits

                edits = stack.enter_context(FileEdits(wanted, _watched(arguments)))
                request = replace(request, edits=edits)
            shown = stack.enter_context(Shown(arguments))
            simulated = simulate_fitted(found, request, shown.hear, shown.cancellation)
        return _concluded(arguments, simulated)


def _watched(arguments: argparse.Namespace) -> list[str]:
    """The files that a program is made of."""
    return [arguments.file, *arguments.properties]


def _request(arguments: argparse.Namespace) -> SimulationRequest:
    from koord.api.sim_run import SimulationRequest

    outputs = Outputs(
        html=(_PAGE if arguments.html is None else arguments.html) or None,
        view=arguments.view,
        record=tuple(arguments.record),
        plot=arguments.plot,
        trace=arguments.trace,
        live=arguments.live,
        pace=arguments.pace,
    )
    return SimulationRequest(
        rounds=arguments.rounds,
        duration_s=arguments.time,
        keep_going=arguments.keep_going,
        check_summaries=arguments.check_summaries,
        processes=arguments.processes,
        outputs=outputs,
        kernels=arguments.kernels == "on",
        planners=arguments.planners,
        reload=arguments.reload,
        ask=arguments.ask,
    )


def _check_single(arguments: argparse.Namespace) -> None:
    """Refuse flags that only campaigns have. Raises ArgumentTypeError."""
    given = {
        "--csv": arguments.csv is not None,
        "--parquet": arguments.parquet is not None,
        "--resume": arguments.resume,
        "--cluster": arguments.cluster is not None,
        "--jobs": arguments.jobs != 1,
    }
    for name, is_given in given.items():
        if is_given:
            raise argparse.ArgumentTypeError(f"{name} is of campaigns: say --runs K")


def _check_unsplit(arguments: argparse.Namespace) -> None:
    """Refuse flags that only splitting has. Raises ArgumentTypeError."""
    for name in ("level", "particles"):
        if getattr(arguments, name) is not None and arguments.splitting is None:
            raise argparse.ArgumentTypeError(f"--{name} is of splitting: say --splitting CLAIM")


def _rehearse(arguments: argparse.Namespace) -> int:
    """Play a recorded run."""
    from koord.api.rehearsal import rehearse
    from koord.cli.simulated import Shown

    given = {
        "CONFIG": arguments.config is not None,
        "--scene": arguments.scene is not None,
        "--robots": arguments.robots is not None,
        "--seed": arguments.seed is not None,
        "--delta": arguments.delta is not None,
        "--set": bool(arguments.settings),
        "--runs": arguments.runs is not None,
        "--until": arguments.until is not None,
        "--sweep": arguments.sweep is not None,
        "--splitting": arguments.splitting is not None,
        "--trace": arguments.trace is not None,
        "--processes": arguments.processes,
        "--planners": arguments.planners != 0,
        "--reload": arguments.reload,
        "--ask": arguments.ask,
    }
    for name, is_given in given.items():
        if is_given:
            raise argparse.ArgumentTypeError(
                f"--schedule plays a run as it is recorded: leave out {name}"
            )
    _check_single(arguments)
    request = _request(arguments)
    request.outputs.check()
    source = read_program(arguments.file).source
    raw, name = read_written(arguments.schedule), arguments.schedule
    with Shown(arguments) as shown:
        simulated = rehearse(source, raw, name, request, shown.hear, shown.cancellation)
    return _concluded(arguments, simulated)


def _concluded(arguments: argparse.Namespace, simulated: Simulated) -> int:
    """Report the files kept, and return the exit code."""
    from koord.api.sim_report import Ending

    if simulated.kept and not arguments.json:
        print(f"kept: {', '.join(map(visible, simulated.kept))}")
    if simulated.kept_code:
        print(
            f"machine code was made for this, and is kept in {visible(simulated.kept_code)}:"
            " the next run starts sooner",
            file=sys.stderr,
        )
    if (refused := simulated.refused) is not None:
        print(
            f"the trace is none of the semantics: [{refused.rule}] {refused.reason}",
            file=sys.stderr,
        )
        return Exit.VIOLATED
    if simulated.ending is Ending.INTERRUPTED:
        return Exit.INTERRUPTED
    if simulated.broken or simulated.fault is not None:
        return Exit.VIOLATED
    if simulated.standing:
        return Exit.STUCK
    in_trouble = simulated.processes is not None and bool(simulated.processes.died)
    return Exit.VIOLATED if in_trouble else Exit.OK
