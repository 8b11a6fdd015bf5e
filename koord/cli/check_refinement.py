"""``koord check-refinement [FILE…]``: does what runs do what the rules allow?"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from fractions import Fraction
from itertools import cycle, islice
from pathlib import Path
from random import Random

from msgspec import Struct

from koord.api.files import check_writable
from koord.api.programs import Program
from koord.api.robots import AS_STATED, Fleet, system_of
from koord.api.traces import sources_of
from koord.cli.arguments import (
    add_json,
    add_settings,
    check_files,
    delta,
    rounds,
    runs,
    seed,
)
from koord.cli.diagnostics import Report
from koord.cli.exits import Exit
from koord.cli.inputs import Reading, load_programs
from koord.cli.progress import Interruption, LiveLine
from koord.cli.protocol_check import NETWORKS
from koord.cli.refused_runs import RefusedRun, again, problem_of, told
from koord.cli.terminal import Paint, style_of, visible
from koord.refinement.cases import Case, Target, Tried, all_generated, generated, of_program, tried
from koord.refinement.running import Compiled, ready
from koord.refinement.shrinking import TRIES, ever_smaller
from koord.syntax import core
from koord.syntax.system import System

#: So many robots, in turn.
_ROBOTS = (1, 2, 3, 4)

#: What may be checked besides all of it.
_PROTOCOL = "protocol"

#: Where programs may run besides: in a world, with the configuration that lies beside them.
_SIMULATOR = "simulator"

#: Of so many runs on the engine, one more on each of the others: they take longer.
_SHARES = {Target.ENGINE: 1, Target.NETWORK: 10, Target.UDP: 50}

#: Processes do not do the same thing twice, so that making a run smaller is soon a matter of luck.
_TRIES_OVER_UDP = 10


class Totals(Struct):
    """What runs did on a target. Runs that gave up found no values that the program allows."""

    target: Target
    runs: int = 0
    rounds: int = 0
    steps: int = 0
    faults: int = 0
    skips: int = 0
    gave_up: int = 0

    def add(self, one: Tried) -> None:
        self.runs += 1
        if one.judged is not None and one.ran is not None:
            rounds_ = one.ran.trace.recording.rounds
            self.rounds += len(rounds_)
            self.skips += sum(event is None for round_ in rounds_ for event in round_.events)
            self.steps += one.judged.steps
            self.faults += one.ran.fault_place is not None
            self.gave_up += one.ran.gave_up is not None


class _Run(Struct, frozen=True):
    """What became of a run, its place among those of its program, and what that was compiled to."""

    outcome: Tried
    number: int
    made: Compiled | None = None


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files",
        metavar="FILE",
        nargs="*",
        help="a program (.krd); - is standard input. Without any, programs are generated",
    )
    parser.add_argument(
        "--runs", metavar="K", type=runs, default=100, help="how many runs of each program (100)"
    )
    parser.add_argument(
        "--target",
        choices=[*(target.value for target in Target), _SIMULATOR, _PROTOCOL],
        help="where programs run: in one process, over a simulated network, as processes over UDP; "
        "or: K/50 runs in a simulated world; or: check the round-commit protocol alone (K runs in "
        "one process, K/10 over a simulated network, K/50 over UDP)",
    )
    parser.add_argument(
        "--rounds", metavar="R", type=rounds, default=8, help="how many rounds a run (8)"
    )
    parser.add_argument(
        "--delta",
        metavar="SECONDS",
        type=delta,
        help="of a round (as the program states; else 0.1)",
    )
    parser.add_argument(
        "--faults",
        choices=["none", "loss", "chaos"],
        default="none",
        help="what happens to messages; chaos: robots crash and come back besides (none)",
    )
    parser.add_argument(
        "--seed", metavar="S", type=seed, default=0, help="what every random choice hangs on (0)"
    )
    parser.add_argument(
        "--case",
        metavar="SEED",
        type=seed,
        help="the generated program of this seed alone, as a file that was kept says",
    )
    parser.add_argument(
        "--save",
        metavar="FOLDER",
        default=".",
        help="where the files of a run that is refused go (.)",
    )
    add_settings(parser)
    add_json(parser, "what was found")
    parser.epilog = (
        "exit codes: 0 every run is one of the rules, 1 one is not, 2 errors in the input"
    )


def main(arguments: argparse.Namespace) -> int:
    check_files([*arguments.files, *arguments.properties])
    if arguments.target == _PROTOCOL:
        return _protocol(arguments)
    if arguments.target == _SIMULATOR:
        return _simulator(arguments)
    if arguments.case is not None and arguments.files:
        raise argparse.ArgumentTypeError("--case is of a generated program, and needs no file")
    report = Report()
    programs = load_programs(arguments.files, Reading.of(arguments), report)
    if report.errors and arguments.json:
        report.print(sys.stdout, as_json=True)
    else:
        report.print(sys.stderr, as_json=False)
    if report.errors:
        return Exit.BAD_INPUT
    check_writable(str(Path(arguments.save) / "refinement"))
    everything = {target: Totals(target) for target in _targets(arguments)}
    failure: RefusedRun | None = None
    if not arguments.json:
        for loaded in programs:
            print(visible(_about(loaded, arguments)))
    with Interruption() as interruption, LiveLine(sys.stderr) as line:
        for one in _all(arguments, programs):
            totals = everything[one.outcome.case.target]
            totals.add(one.outcome)
            line.show(f"{totals.target.value}: {totals.runs} {_many('run', totals.runs)}")
            if one.outcome.failed:
                command = again(arguments, one.outcome.case, one.number)
                failure = RefusedRun(one.outcome, command, arguments.save)
                failure.keep()
                line.clear()
                said = visible(f"refused and kept: {failure.path}; smaller runs are looked for")
                print(said, file=sys.stderr, flush=True)
                line.show("looking for smaller runs that are refused")
                _make_smaller(failure, one.made, interruption)
            if failure is not None or interruption.requested:
                break
    if arguments.json:
        about = [_about(loaded, arguments) for loaded in programs]
        document = _document(list(everything.values()), failure) | {"programs": about}
        sys.stdout.write(json.dumps(document, indent=2) + "\n")
    else:
        _show(list(everything.values()), failure)
    if interruption.requested:
        return Exit.INTERRUPTED
    return Exit.OK if failure is None else Exit.VIOLATED


def _about(loaded: Program, arguments: argparse.Namespace) -> str:
    """A program that is run, with δ and each value that is not the text's."""
    problem = loaded.problem(None, arguments.delta)
    return f"{problem.name}: {', '.join(problem.values)}"


def _protocol(arguments: argparse.Namespace) -> int:
    if arguments.files or arguments.case is not None:
        raise argparse.ArgumentTypeError(
            "--target protocol is of no program: it takes no file, no case"
        )
    from koord.cli.protocol_check import main as check

    return check(arguments)


def _simulator(arguments: argparse.Namespace) -> int:
    if not arguments.files or arguments.case is not None:
        raise argparse.ArgumentTypeError("--target simulator takes programs: name a file")
    from koord.runtime.motion.libraries import SIM, require

    require(SIM, "sim")
    from koord.cli.check_simulated import main as check

    return check(arguments)


# --- runs ---------------------------------------------------------------------------------------


def _targets(arguments: argparse.Namespace) -> tuple[Target, ...]:
    """Where programs are to run. A generated one that was kept did so on the engine, or is told."""
    if arguments.target is not None:
        return (Target(arguments.target),)
    return (Target.ENGINE,) if arguments.case is not None else tuple(Target)


def _all(arguments: argparse.Namespace, programs: tuple[Program, ...]) -> Iterator[_Run]:
    """Every run, as it is made."""
    faults, most, seed = NETWORKS[arguments.faults], arguments.rounds, arguments.seed
    targets = _targets(arguments)
    if arguments.case is not None:
        yield _Run(tried(generated(arguments.case, most, targets[0], faults)), 1)
        return
    for target in targets:
        runs = arguments.runs if len(targets) == 1 else -(-arguments.runs // _SHARES[target])
        if not programs:
            for case in islice(all_generated(Random(seed), most, target, faults), runs):
                yield _Run(tried(case), 1)
        for loaded in programs:
            made = ready(loaded.core)
            systems = _systems(loaded.core, arguments.delta)
            of = sources_of(loaded)
            cases = of_program(of, systems, most, Random(seed), target, faults)
            for number, case in enumerate(islice(cases, runs), start=1):
                yield _Run(tried(case, made), number, made)


def _systems(program: core.Program, delta_s: Fraction | None) -> Iterator[System]:
    """The program with the robots that it states; else with one number of them after the other."""
    stated = program.instance
    fleets = [AS_STATED] if stated.kinds else [Fleet(total) for total in _ROBOTS]
    return (system_of(program, fleet, delta_s) for fleet in cycle(fleets))


def _make_smaller(found: RefusedRun, made: Compiled | None, interruption: Interruption) -> None:
    """Look for smaller runs that fail as well; Ctrl-C is enough of it.

    Of a program that was compiled once for all runs, the program stays as it is.
    """

    def attempt(case: Case) -> Tried:
        if interruption.requested:
            raise KeyboardInterrupt
        return tried(case, made)

    tries = _TRIES_OVER_UDP if found.outcome.case.target is Target.UDP else TRIES
    try:
        for smaller in ever_smaller(found.outcome, attempt, programs=made is None, tries=tries):
            found.replace(smaller)
    except KeyboardInterrupt:
        interruption.cancel()


# --- what is told -------------------------------------------------------------------------------


def _document(everything: list[Totals], failure: RefusedRun | None) -> dict[str, object]:
    targets = [
        {
            "target": totals.target.value,
            "runs": totals.runs,
            "rounds": totals.rounds,
            "steps": totals.steps,
            "skips": totals.skips,
            "faults": totals.faults,
            "gaveUp": totals.gave_up,
        }
        for totals in everything
    ]
    return {
        "format": "koord-refinement",
        "version": 1,
        "targets": targets,
        "failure": None if failure is None else failure.document(),
    }


def _show(everything: list[Totals], failure: RefusedRun | None) -> None:
    style = style_of(sys.stdout)
    if failure is not None:
        said, case = style.paint("refused", Paint.ERROR), failure.outcome.case
        print(f"{said}: {visible(str(problem_of(case)))}, {case.target.value}, seed {case.seed}")
        for line in told(failure.outcome):
            print(f"  {visible(line)}")
        print(f"  saved as {visible(failure.path or '')}")
        print(f"  again, as it was found: {visible(failure.again)}")
    for totals in everything:
        if totals.runs:
            print(
                _line(
                    totals,
                    failed=failure is not None and failure.outcome.case.target is totals.target,
                )
            )


def _line(totals: Totals, *, failed: bool) -> str:
    """What runs on a target did."""
    counted = f"{totals.target.value}: {totals.runs} {_many('run', totals.runs)}, {totals.rounds} "
    counted += f"{_many('round', totals.rounds)}, {totals.steps} {_many('step', totals.steps)}"
    ends = f"{totals.faults} ended in a fault"
    if totals.gave_up:
        ends += f", {totals.gave_up} for want of values that the program allows"
    return f"{counted}: {'1 violation' if failed else 'no violation'} ({ends})"


def _many(word: str, count: int) -> str:
    return word if count == 1 else f"{word}s"
