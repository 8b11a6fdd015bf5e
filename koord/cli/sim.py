"""``koord sim FILE [CONFIG]``: run a program in a simulated world, and tell what it came to."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from koord.cli.arguments import (
    add_files,
    add_json,
    add_settings,
    add_trace,
    check_files,
    delta,
    jobs,
    rounds,
    runs,
    seconds,
    seed,
    sweep,
)
from koord.cli.exits import Exit
from koord.cli.keeping import add_outputs, check_outputs, watched
from koord.syntax.core import MOST_ROBOTS
from koord.syntax.diagnostics import KoordError

if TYPE_CHECKING:
    from koord.cli.simulated_traces import Tracing
    from koord.cli.simulating import Job
    from koord.sim.running import Simulation


def configure(parser: argparse.ArgumentParser) -> None:
    add_files(parser, several=False)
    parser.add_argument(
        "config",
        metavar="CONFIG",
        nargs="?",
        help="the configuration of the run (.yaml); else the one beside the program, if there is "
        "one of its name",
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
    add_outputs(parser)
    parser.add_argument(
        "--processes",
        action="store_true",
        help="each robot in a process of its own, over UDP; with --pace 1 as quickly as time goes "
        "by, else without waiting",
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
        "--csv",
        metavar="FILE",
        help="a line of figures for each of several runs, written as the run ends",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on with a campaign that was ended: runs that stand in the --csv file are not made "
        "again",
    )
    add_settings(parser)
    add_json(parser, "what the run came to")
    parser.epilog = (
        "exit codes: 0 done, 1 something was broken, or a fault ended the run, "
        "2 errors in the input, 5 a robot stands still that is to go somewhere, "
        "130 stopped with Ctrl-C"
    )


def _robots(text: str) -> int:
    if not text.isascii() or not text.isdigit() or not 1 <= int(text[:9]) <= MOST_ROBOTS:
        raise argparse.ArgumentTypeError(f"robots must be from 1 to {MOST_ROBOTS}, not {text!r}")
    return int(text)


def main(arguments: argparse.Namespace) -> int:
    # What simulating needs is loaded here: `koord sim --help` is as light as any other.
    from koord.runtime.motion.libraries import SIM, require

    require(SIM, "sim")
    from koord.cli.diagnostics import Report
    from koord.cli.fitting import asked

    if arguments.schedule is not None:
        return _rehearse(arguments)
    config = [arguments.config] if arguments.config is not None else []
    check_files([arguments.file, *config, *arguments.properties])
    is_campaign = arguments.runs is not None or arguments.sweep is not None
    if is_campaign:
        from koord.cli.campaigns import campaign, check_campaign

        check_campaign(arguments)
    else:
        _check_single(arguments)
        check_outputs(arguments)
    report = Report()
    wanted = asked(arguments, report)
    job = None
    if wanted is not None:
        try:
            job = wanted.job(report, arguments.robots, arguments.seed)
        except KoordError as error:
            report.add(error.diagnostics)
    out = sys.stdout if report.errors and arguments.json else sys.stderr
    report.print(out, as_json=arguments.json and out is sys.stdout)
    if job is None or report.errors:
        return Exit.BAD_INPUT
    if is_campaign:
        assert wanted is not None
        return campaign(arguments, wanted, job.scene.seed)
    tracing = None
    if arguments.trace is not None:
        from koord.cli.simulated_traces import Tracing

        tracing = Tracing(job)
    if arguments.processes:
        from koord.cli.processes import simulate

        job.check_start(job.begun())
        return simulate(arguments, job, tracing)
    simulation = job.simulation(
        keep_going=arguments.keep_going, summaries=arguments.check_summaries, tracing=tracing
    )
    return _run(arguments, job, simulation, tracing)


def _check_single(arguments: argparse.Namespace) -> None:
    """Whether nothing is asked for that campaigns alone have."""
    given = {
        "--csv": arguments.csv is not None,
        "--resume": arguments.resume,
        "--cluster": arguments.cluster is not None,
        "--jobs": arguments.jobs != 1,
    }
    for name, is_given in given.items():
        if is_given:
            raise argparse.ArgumentTypeError(f"{name} is of campaigns: say --runs K")


def _rehearse(arguments: argparse.Namespace) -> int:
    """Play a recorded run."""
    from koord.cli.rehearsals import rehearsal

    given = {
        "CONFIG": arguments.config is not None,
        "--robots": arguments.robots is not None,
        "--seed": arguments.seed is not None,
        "--delta": arguments.delta is not None,
        "--set": bool(arguments.settings),
        "--runs": arguments.runs is not None,
        "--sweep": arguments.sweep is not None,
        "--trace": arguments.trace is not None,
        "--processes": arguments.processes,
    }
    for name, is_given in given.items():
        if is_given:
            raise argparse.ArgumentTypeError(
                f"--schedule plays a run as it is recorded: leave out {name}"
            )
    _check_single(arguments)
    check_outputs(arguments)
    job, simulation = rehearsal(arguments)
    return _run(arguments, job, simulation, None)


def _run(
    arguments: argparse.Namespace, job: Job, simulation: Simulation, tracing: Tracing | None
) -> int:
    import time

    from koord.cli.concluding import concluded
    from koord.cli.progress import Interruption, LiveLine
    from koord.cli.simulated import Noticed, heading, progress
    from koord.sim.running import Ending, run

    limit_s = job.limit_s(arguments.rounds, arguments.time)
    began = time.perf_counter()
    first = simulation.begin()
    if tracing is not None:
        tracing.begun(first, simulation)
    job.check_start(simulation)
    if not arguments.json:
        print(heading(job))
    with (
        watched(arguments, simulation, tracing) as over,
        Interruption() as interruption,
        LiveLine(sys.stderr) as line,
    ):
        told = Noticed(line)
        for decision in run(simulation, limit_s):
            line.show(progress(simulation))
            if tracing is not None:
                tracing.round(decision, simulation)
            over(simulation.time_s)
            told.tell(simulation)
            if interruption.requested:
                simulation.end(Ending.INTERRUPTED)
    wall_s = time.perf_counter() - began
    return concluded(arguments, job, simulation, tracing, wall_s)
