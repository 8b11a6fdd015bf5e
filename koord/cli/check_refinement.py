"""``koord check-refinement [FILE…]``: are runs of compiled programs runs of the semantics?"""

from __future__ import annotations

import argparse
import json
import sys
from itertools import groupby
from typing import TYPE_CHECKING

from koord.api.files import write_atomically
from koord.api.programs import Program
from koord.api.progress import Progress
from koord.api.refinement import (
    NETWORKS,
    Refinement,
    RefineRequest,
    RunRefused,
    Target,
    TargetRuns,
    about_of,
    refine_loaded,
)
from koord.api.results import ArgumentError
from koord.cli.arguments import (
    add_html,
    add_json,
    add_settings,
    check_files,
    delta,
    rounds,
    runs,
    seed,
)
from koord.cli.diagnostics import DiagnosticReport
from koord.cli.exits import Exit
from koord.cli.files import check_writable
from koord.cli.fitting import fit_request
from koord.cli.inputs import ReadOptions, load_programs
from koord.cli.progress import Interruption, LiveLine
from koord.cli.proofs import code_of_proof
from koord.cli.terminal import Paint, style_of, visible
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import counted

if TYPE_CHECKING:
    from koord.api.protocol_check import ProtocolCheck, ProtocolProof
    from koord.api.refine_simulated import SimulatedRuns


def check_protocol_alone(arguments: argparse.Namespace) -> int:
    """Check the protocol, print the result, and return the exit code."""
    from koord.api.protocol_check import check_protocol

    checked = check_protocol(runs=arguments.runs, seed=arguments.seed, faults=arguments.faults)
    if arguments.json:
        sys.stdout.write(checked.to_json() + "\n")
    else:
        _show_protocol(checked, arguments.faults)
    return Exit.VIOLATED if checked.broken else Exit.OK


def _show_protocol(checked: ProtocolCheck, network: str) -> None:
    for what, one in checked.explored.items():
        end = "all of them" if one.complete else f"to depth {one.depth}"
        print(f"{what}: {one.states:,} states, {one.transitions:,} transitions, {end}")
    rounds = sum(run.rounds for run in checked.runs)
    crashes = sum(run.crashes for run in checked.runs)
    late = sum(run.skips_late for run in checked.runs)
    print(
        f"{len(checked.runs)} runs on simulated networks ({network}): {rounds:,} rounds, "
        f"{late:,} late proposals, {crashes:,} crashes"
    )
    for one in checked.explored.values():
        if one.violation is not None:
            print("\n".join(f"  {line}" for line in one.violation.story))
    for story in checked.broken:
        print(f"broken: {story}")
    if not checked.broken:
        print("every invariant of specs/protocol held")


def prove_for_every_number(arguments: argparse.Namespace) -> int:
    """Prove the protocol for every number of robots, print the proof, and return the exit code."""
    from koord.api.protocol_check import prove_protocol

    with Interruption() as interruption, LiveLine(sys.stderr) as line:
        proof = prove_protocol(
            progress=lambda told: line.show(told.message), cancellation=interruption
        )
    if arguments.json:
        sys.stdout.write(proof.to_json() + "\n")
    else:
        _show_proof(proof)
    return code_of_proof(proof)


def _show_proof(proof: ProtocolProof) -> None:
    open_ = set(proof.open)
    for about, steps in groupby(proof.steps, lambda one: (one.action, one.rule)):
        of_it = tuple(steps)
        kept = counted(len(of_it) - len(open_.intersection(of_it)), "statement")
        print("{} ({}): {} proved".format(*about, kept) if about[0] else f"claims: {kept} proved")
    for step in proof.open:
        print(f"not proved ({step.answer.value}): {step.action or 'claims'}: {step.statement}")
        for fact in step.counterexample:
            print(f"  {fact}")
    for what, one in proof.explored.items():
        if one.violation is None:
            done = f"{one.states:,} states, {one.transitions:,} transitions"
            print(f"the machine does what the model does, {what}: {done}")
    for stray in proof.strays:
        print("\n".join(f"  {line}" for line in stray.story))
        print(f"the machine does what the model does not: {stray.broken.story}")
    if proof.ok:
        seconds = sum(step.seconds for step in proof.steps)
        print(
            "proved for every number of robots, rounds and epochs: "
            f"{', '.join(proof.invariants)}, in {seconds:.1f} s"
        )


def check_worlds(arguments: argparse.Namespace) -> int:
    """Simulate programs, judge and report their runs, and return the exit code.

    Raises KoordError, also where no world can be simulated for want of libraries.
    """
    from koord.api.refine_simulated import judge_simulated

    totals: list[SimulatedRuns] = []
    with Interruption() as interruption, LiveLine(sys.stderr) as line:
        for file in arguments.files:
            own = {**vars(arguments), "file": file, "config": None, "site": None, "delta": None}
            report = DiagnosticReport()
            wanted = fit_request(argparse.Namespace(**own), report, seed=arguments.seed)
            if wanted is None:
                raise KoordError(tuple(report.diagnostics))
            made = judge_simulated(
                wanted,
                arguments.runs,
                arguments.rounds,
                arguments.save,
                lambda told: line.show(told.message),
                interruption,
            )
            totals.append(made)
    if arguments.json:
        sys.stdout.write(json.dumps([total.to_dict() for total in totals], indent=2) + "\n")
    else:
        for total in totals:
            print(_runs_line(total))
    if interruption.requested:
        return Exit.INTERRUPTED
    return Exit.VIOLATED if any(total.refused for total in totals) else Exit.OK


def _runs_line(total: SimulatedRuns) -> str:
    style = style_of(sys.stdout)
    done = f"{total.runs} runs, {total.rounds} rounds, {total.steps} steps"
    about = ", ".join(filter(None, (visible(total.values), done)))
    if total.refused is None:
        return f"{visible(total.program)}: {about}: no violation"
    said = style.paint("refused", Paint.ERROR)
    saved = "" if total.saved is None else f", saved as {visible(total.saved)}"
    about = visible(f"{total.program}, {total.values}: {total.refused}")
    return f"{said}: {about}{saved}"


#: What may be checked besides all of it.
_PROTOCOL = "protocol"
_GUARDIAN = "guardian"

#: Where programs may run besides: in a world, with the configuration that lies beside them.
_SIMULATOR = "simulator"


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
        choices=[*(target.value for target in Target), _SIMULATOR, _PROTOCOL, _GUARDIAN],
        help="where programs run: in one process, over a simulated network (K/10 runs), as "
        "processes over UDP (K/50), in one process by machine code (if it is asked for), or in a "
        "simulated world (K/50); or, without a program: check the round-commit protocol, or the "
        "guardian",
    )
    parser.add_argument(
        "--for-every-number",
        action="store_true",
        help="with --target protocol: instead, prove it safe for every number of robots (Z3)",
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
        choices=list(NETWORKS),
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
    add_html(parser, "a run that is refused turn by turn, up to the step that is wrong,")
    add_json(parser, "what was found")
    parser.epilog = (
        "exit codes: 0 every run is one of the rules, 1 one is not, 2 errors in the input"
    )


def main(arguments: argparse.Namespace) -> int:
    check_files([*arguments.files, *arguments.properties])
    if arguments.html is not None:
        if arguments.target in (_PROTOCOL, _GUARDIAN, _SIMULATOR):
            raise argparse.ArgumentTypeError(
                f"--html shows runs of programs, and --target {arguments.target} has none to show"
            )
        check_writable(arguments.html, (*arguments.files, *arguments.properties))
    if arguments.target == _PROTOCOL:
        return _protocol(arguments)
    if arguments.for_every_number:
        raise argparse.ArgumentTypeError("--for-every-number needs --target protocol")
    if arguments.target == _GUARDIAN:
        return _guardian(arguments)
    if arguments.target == _SIMULATOR:
        return _simulator(arguments)
    if arguments.case is not None and arguments.files:
        raise argparse.ArgumentTypeError("--case is of a generated program, and needs no file")
    report = DiagnosticReport()
    programs = load_programs(arguments.files, ReadOptions.of(arguments), report)
    if report.errors and arguments.json:
        report.print(sys.stdout, as_json=True)
    else:
        report.print(sys.stderr, as_json=False)
    if report.errors:
        return Exit.BAD_INPUT
    request = RefineRequest(
        runs=arguments.runs,
        target=None if arguments.target is None else Target(arguments.target),
        rounds=arguments.rounds,
        delta_s=arguments.delta,
        faults=arguments.faults,
        seed=arguments.seed,
        case=arguments.case,
        save=arguments.save,
    )
    found = _refined(programs, request, as_json=arguments.json)
    if arguments.json:
        sys.stdout.write(found.to_json() + "\n")
    else:
        _show(found)
    if arguments.html is not None:
        _show_page(found, arguments.html)
    if found.interrupted:
        return Exit.INTERRUPTED
    return Exit.OK if found.failure is None else Exit.VIOLATED


def _show_page(found: Refinement, path: str) -> None:
    """Write the page of the run that is refused; tell if there is none to show."""
    from koord.api.html import html

    try:
        page = html(found)
    except ArgumentError as error:
        print(f"koord check-refinement: {error.message}", file=sys.stderr)
    else:
        write_atomically(path, page.encode("utf-8"))


def _refined(programs: tuple[Program, ...], request: RefineRequest, *, as_json: bool) -> Refinement:
    request.check()
    if not as_json:
        for program in programs:
            print(visible(about_of(program, request)))
    with Interruption() as interruption, LiveLine(sys.stderr) as line:

        def show(told: Progress) -> None:
            if isinstance(told, RunRefused):
                line.clear()
                said = f"refused and kept: {told.refused.path}; smaller runs are looked for"
                print(visible(said), file=sys.stderr, flush=True)
            line.show(told.message)

        return refine_loaded(programs, request, show, interruption)


def _protocol(arguments: argparse.Namespace) -> int:
    if arguments.files or arguments.case is not None:
        raise argparse.ArgumentTypeError(
            "--target protocol is of no program: it takes no file, no case"
        )
    if arguments.for_every_number:
        return prove_for_every_number(arguments)
    return check_protocol_alone(arguments)


def _guardian(arguments: argparse.Namespace) -> int:
    from koord.cli.check_guardian import check_guardian_alone

    if arguments.files or arguments.case is not None:
        raise argparse.ArgumentTypeError(
            "--target guardian is of no program: it takes no file, no case"
        )
    return check_guardian_alone(arguments)


def _simulator(arguments: argparse.Namespace) -> int:
    if not arguments.files or arguments.case is not None:
        raise argparse.ArgumentTypeError("--target simulator takes programs: name a file")

    return check_worlds(arguments)


# --- what is told -------------------------------------------------------------------------------


def _show(found: Refinement) -> None:
    style, failure = style_of(sys.stdout), found.failure
    if failure is not None:
        said, case = style.paint("refused", Paint.ERROR), failure.case
        print(f"{said}: {visible(str(failure.problem))}, {case.target.value}, seed {case.seed}")
        for line in failure.lines():
            print(f"  {visible(line)}")
        print(f"  saved as {visible(failure.path or '')}")
        print(f"  again, as it was found: {visible(failure.again)}")
    for one in found.targets:
        if one.runs:
            failed = failure is not None and failure.case.target is one.target
            print(_line(one, failed=failed))


def _line(totals: TargetRuns, *, failed: bool) -> str:
    """Describe the totals of runs on a target."""
    counts = ((totals.runs, "run"), (totals.rounds, "round"), (totals.steps, "step"))
    done = ", ".join(counted(*one) for one in counts)
    ends = f"{totals.faults} ended in a fault"
    if totals.gave_up:
        ends += f", {totals.gave_up} for want of values that the program allows"
    if totals.target is Target.KERNELS:
        done += f", {totals.turns_by_code:,} turns by kernels and {totals.turns_by_robots:,} not"
    found = "1 violation" if failed else "no violation"
    return f"{totals.target.value}: {done}: {found} ({ends})"
