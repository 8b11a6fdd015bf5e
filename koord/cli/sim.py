"""``koord sim FILE [CONFIG]``: run a program in a simulated world, and tell what it came to."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from koord.cli.arguments import (
    MOST_ROBOTS,
    add_files,
    add_json,
    add_settings,
    add_trace,
    check_files,
    delta,
    rounds,
    seconds,
    seed,
)
from koord.cli.exits import Exit
from koord.cli.keeping import add_outputs, check_outputs, keep
from koord.syntax.diagnostics import KoordError

if TYPE_CHECKING:
    from koord.cli.simulating import Job
    from koord.sim.running import Simulation

#: A run ends after so long: of a program that can stop, and of one that cannot.
_LONG_S, _ENDLESS_S = 600.0, 120.0


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
        help=f"end after so much simulated time ({_LONG_S:g}; {_ENDLESS_S:g} if the program "
        "cannot stop)",
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
    add_settings(parser)
    add_json(parser, "what the run came to")
    parser.epilog = (
        "exit codes: 0 done, 1 something was broken, or a fault ended the run, "
        "2 errors in the input, 130 stopped with Ctrl-C"
    )


def _robots(text: str) -> int:
    if not text.isascii() or not text.isdigit() or not 1 <= int(text[:9]) <= MOST_ROBOTS:
        raise argparse.ArgumentTypeError(f"robots must be from 1 to {MOST_ROBOTS}, not {text!r}")
    return int(text)


def main(arguments: argparse.Namespace) -> int:
    # What simulating needs is loaded here: `koord sim --help` is as light as any other.
    from koord.cli.diagnostics import Report
    from koord.cli.simulating import asked
    from koord.runtime.motion.libraries import SIM, require

    config = [arguments.config] if arguments.config is not None else []
    check_files([arguments.file, *config, *arguments.properties])
    require(SIM, "sim")
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
    return _run(arguments, job)


def _run(arguments: argparse.Namespace, job: Job) -> int:
    import time

    from koord.cli.progress import Interruption, LiveLine
    from koord.cli.simulated import as_document, conclusion, heading, table
    from koord.cli.simulated_traces import Tracing
    from koord.cli.terminal import visible
    from koord.cli.traces import write_trace
    from koord.sim.running import Ending, run

    limit_s = _limit(arguments, job)
    tracing = Tracing(job) if arguments.trace is not None else None
    simulation = job.simulation(
        keep_going=arguments.keep_going, summaries=arguments.check_summaries, tracing=tracing
    )
    began = time.perf_counter()
    first = simulation.begin()
    if tracing is not None:
        tracing.begun(first, simulation)
    job.check_start(simulation)
    if not arguments.json:
        print(heading(job))
    with Interruption() as interruption, LiveLine(sys.stderr) as line:
        for decision in run(simulation, limit_s):
            line.show(_progress(simulation))
            if tracing is not None:
                tracing.round(decision, simulation)
            if interruption.requested:
                simulation.end(Ending.INTERRUPTED)
    wall_s = time.perf_counter() - began
    told = None
    if tracing is not None:
        ran = tracing.ran(simulation)
        write_trace(arguments.trace, tracing.trace(ran))
        told = tracing.judged(ran)
    if arguments.json:
        sys.stdout.write(as_document(job, simulation, wall_s))
    else:
        for text in (*table(simulation, wall_s), *conclusion(job, simulation)):
            print(text)
    kept = keep(arguments, simulation.recording)
    if kept and not arguments.json:
        print(f"kept: {', '.join(map(visible, kept))}")
    if told is not None and told.refused is not None:
        print(
            f"the trace is none of the semantics: [{told.refused.rule}] {told.refused.reason}",
            file=sys.stderr,
        )
        return Exit.VIOLATED
    return _code(simulation)


def _limit(arguments: argparse.Namespace, job: Job) -> float:
    """How long the run may take, in simulated time."""
    from koord.syntax import core
    from koord.syntax.walk import nodes

    given = []
    if arguments.rounds is not None:
        given.append(arguments.rounds * job.scene.delta_s)
    if arguments.time is not None:
        given.append(arguments.time)
    if given:
        return float(min(given))
    events = [event.effect for agent in job.loaded.program.agents for event in agent.events]
    stops = any(isinstance(node, core.Stop | core.TryStop) for node in nodes(tuple(events)))
    return _LONG_S if stops else _ENDLESS_S


def _progress(simulation: Simulation) -> str:
    figures = simulation.gauge
    done, tasks = figures.visited, figures.tasks
    said = f"{simulation.time_s:.1f} s simulated"
    return f"{said}, {done} of {tasks} tasks" if tasks else said


def _code(simulation: Simulation) -> Exit:
    from koord.sim.running import Ending

    if simulation.ending is Ending.INTERRUPTED:
        return Exit.INTERRUPTED
    broken = bool(simulation.broken) or simulation.fault is not None
    return Exit.VIOLATED if broken else Exit.OK
