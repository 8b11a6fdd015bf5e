"""``koord run FILE``: run a program by the rules of the semantics, and show each round."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from enum import Enum
from fractions import Fraction
from functools import partial
from random import Random
from typing import BinaryIO

from msgspec import Struct
from msgspec.structs import replace

from koord.api.files import write_atomically
from koord.api.growing import Growing, part_of, remove_part
from koord.api.programs import Program
from koord.api.results import ArgumentError
from koord.api.robots import Fleet, system_of
from koord.api.traces import complete_trace, sources_of, write_trace
from koord.cli.arguments import (
    add_bounds,
    add_files,
    add_json,
    add_settings,
    add_trace,
    check_files,
)
from koord.cli.diagnostics import Report, report_error
from koord.cli.excerpt import place
from koord.cli.exits import Exit
from koord.cli.files import DASH, check_writable
from koord.cli.inputs import Reading, load_programs
from koord.cli.interactive import Interactive
from koord.cli.progress import Interruption
from koord.cli.tables import Rounds, Table
from koord.cli.terminal import Paint, Style, style_of, visible
from koord.sampling.monitors import Watch
from koord.sampling.policies import AtRandom, First, Play
from koord.sampling.running import Moment, Run, new_run
from koord.semantics.configurations import NO_EVENT
from koord.syntax.budget import OutOfPatienceError, Patience
from koord.syntax.core import PropertyKind
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.traces.codec import encode
from koord.traces.names import Names
from koord.traces.parts import PartTrace
from koord.traces.trace import (
    BEFORE_ROUNDS,
    Numbers,
    Sources,
    Trace,
    Tracer,
    Violation,
    ViolationKind,
    assembled,
)

#: A trace grows so often: a step may take long, and what was before it is to be there then.
_PERIOD_S = 0.05


class Policy(Enum):
    """Which of the allowed steps is taken."""

    FIRST = "first"  #: the first enabled event in the order of the program, as robots do
    RANDOM = "random"  #: any allowed step, by the seed


class Request(Struct, frozen=True):
    """How a program is to be run."""

    fleet: Fleet
    rounds: int
    delta_s: Fraction | None  #: None: as the program states
    policy: Policy
    seed: int
    interactive: bool
    trace: str | None
    numbers: Numbers = Numbers.EXACT
    as_json: bool = False


def configure(parser: argparse.ArgumentParser) -> None:
    add_files(parser, several=False)
    add_bounds(parser)
    parser.add_argument(
        "--policy",
        choices=[policy.value for policy in Policy],
        default=Policy.FIRST.value,
        help="which of the allowed steps is taken (first)",
    )
    parser.add_argument(
        "--interactive", action="store_true", help="ask which robot and event is next"
    )
    parser.add_argument(
        "--numbers",
        choices=[numbers.value for numbers in Numbers],
        default=Numbers.EXACT.value,
        help="what a float is: an exact rational, or a double as on robots (exact)",
    )
    add_settings(parser)
    add_trace(parser, "the run")
    add_json(parser, "the trace")
    parser.epilog = "exit codes: 0 done, 1 a fault or a violation was met, 2 errors in the input"


def main(arguments: argparse.Namespace) -> int:
    check_files([arguments.file, *arguments.properties])
    request = Request(
        fleet=arguments.robots,
        rounds=arguments.rounds,
        delta_s=arguments.delta,
        policy=Policy(arguments.policy),
        seed=arguments.seed,
        interactive=arguments.interactive,
        trace=arguments.trace,
        numbers=Numbers(arguments.numbers),
        as_json=arguments.json,
    )
    if request.interactive and request.as_json:
        raise argparse.ArgumentTypeError("--interactive and --json do not go together")
    if request.interactive and DASH in (arguments.file, *arguments.properties):
        raise argparse.ArgumentTypeError("--interactive reads standard input, and so does -")
    if request.trace is not None:
        check_writable(request.trace, (arguments.file, *arguments.properties))
    report = Report()
    programs = load_programs([arguments.file], Reading.of(arguments), report)
    if report.errors and request.as_json:
        report.print(sys.stdout, as_json=True)
    else:
        report.print(sys.stderr, as_json=False)
    if report.errors:
        return Exit.BAD_INPUT
    try:
        return _run(programs[0], request)
    except ArgumentError:
        raise
    except KoordError as error:  # of the program, met on the way
        report_error(error, as_json=request.as_json, sources=report.sources.values())
        return Exit.BAD_INPUT


def _run(loaded: Program, request: Request) -> Exit:
    interruption = Interruption()
    system = system_of(loaded.core, request.fleet, request.delta_s)
    if not request.interactive:
        system = replace(system, patience=Patience(lambda: interruption.requested))
    rng = Random(request.seed)
    run = new_run(system, request.numbers, rng)
    watch = Watch(run.d, system, run.inputs)
    table = Table(Names(system), style_of(sys.stdout))
    if not request.as_json:
        print(_heading(loaded, request, system))
    if request.interactive:
        return _by_hand(loaded, request, Interactive(run, watch, table, request.rounds))
    policy = First() if request.policy is Policy.FIRST else AtRandom(rng)
    play = Play(run, policy, request.rounds, watch)
    return _by_policy(loaded, request, play, table, interruption)


def _by_policy(
    loaded: Program, request: Request, play: Play, table: Table, interruption: Interruption
) -> Exit:
    tracer = Tracer() if request.trace is not None or request.as_json else None
    rounds = None if request.as_json else Rounds(table)
    kept: Moment | None = None
    sources = sources_of(loaded)
    with interruption, Growing(_PERIOD_S) as growing:
        if request.trace is not None:
            assert tracer is not None
            growing.add(request.trace, partial(_part, tracer, sources, play))
        try:
            for taken in play.steps():
                kept = play.run.moment
                if tracer is not None:
                    tracer.add(taken.step)
                if taken.step.robot is None:  # between two rounds
                    growing.grow()
                if rounds is not None:
                    rounds.show(taken)
                if interruption.requested:
                    break
        except OutOfPatienceError:
            # A step that is half done does not count.
            if kept is None:
                print("interrupted while looking for a start", file=sys.stderr)
                return Exit.INTERRUPTED
            play.run.go_back(kept)
        finally:
            if rounds is not None:
                rounds.close()
    run, violation = play.run, play.violation
    if tracer is not None:
        trace = tracer.trace(sources, run.system, run.numbers, play.recording(), violation)
        _keep(trace, request)
    if interruption.requested:
        if not request.as_json:
            print(f"\ninterrupted after {_rounds(run)}")
        return Exit.INTERRUPTED
    if not request.as_json:
        _conclude(loaded, run, violation)
    return _code(run, violation)


def _part(tracer: Tracer, sources: Sources, play: Play, file: BinaryIO) -> Callable[[], None]:
    """Begins a file that the run's trace grows in, and gives what writes behind it."""
    part, run = PartTrace(file), play.run

    def grow() -> None:
        if tracer.configurations:
            recording = play.recording()
            part.grow(tracer.trace(sources, run.system, run.numbers, recording, play.violation))

    return grow


def _by_hand(loaded: Program, request: Request, session: Interactive) -> Exit:
    def trace() -> Trace:
        recording = run.recording(checks=session.violation is not None)
        steps, violation = session.taken, session.violation
        return assembled(sources_of(loaded), run.system, run.numbers, recording, steps, violation)

    def keep() -> None:
        """Steps may be taken back, so it is written anew."""
        if request.trace is not None:
            write_atomically(part_of(request.trace), encode(trace()))

    run = session.run
    session.play(keep)
    violation = session.violation
    if request.trace is not None:
        _keep(trace(), request, has_grown=False)
    _conclude(loaded, run, violation)
    return _code(run, violation)


def _keep(trace: Trace, request: Request, *, has_grown: bool = True) -> None:
    if request.trace is not None:
        if has_grown:
            complete_trace(request.trace, trace)
        else:
            write_trace(request.trace, trace)
        remove_part(request.trace)
    if request.as_json:
        sys.stdout.write(encode(trace).decode("utf-8"))


def _code(run: Run, violation: Violation | None) -> Exit:
    broken = violation is not None or run.configuration.fault is not None
    return Exit.VIOLATED if broken else Exit.OK


# --- what is printed ----------------------------------------------------------------------------


def _heading(loaded: Program, request: Request, system: System) -> str:
    how = "by hand" if request.interactive else f"policy {request.policy.value}"
    problem = loaded.problem(system.kinds, system.delta_s)
    return f"{visible(str(problem))}, {how}, seed {request.seed}"


def _conclude(loaded: Program, run: Run, violation: Violation | None) -> None:
    for line in conclusion(loaded, run, violation, style_of(sys.stdout)):
        print(line)


def conclusion(
    loaded: Program, run: Run, violation: Violation | None, style: Style
) -> Iterator[str]:
    """How a run ended, with the place in the text that is to blame, if any."""
    fault = run.configuration.fault
    yield ""
    if fault is not None:
        whose = "" if fault.robot is None else f" of robot {fault.robot}"
        said = style.paint("fault", Paint.ERROR)
        yield f"{said}: {fault.kind.value}{whose}, {_when(run.configuration.round, run)}"
        yield from place(loaded.sources, fault.span, style)
    elif violation is not None:
        said = style.paint("violated", Paint.ERROR)
        yield f"{said}: {violation.name} does not hold, {_after(violation, run)}"
        yield from place(loaded.sources, _span_of(violation, run), style)
    else:
        ended = ", and then every robot has stopped" if run.all_stopped else ""
        invariants = sum(p.kind in _SAFETY for p in run.system.program.properties)
        held = (
            f"; {invariants} invariant{'' if invariants == 1 else 's'} held" if invariants else ""
        )
        yield f"{style.paint('done', Paint.ADDED)}: {_rounds(run)}{ended}, no fault{held}"


def _rounds(run: Run) -> str:
    return f"{run.round} round{'' if run.round == 1 else 's'}"


_SAFETY = (PropertyKind.INVARIANT, PropertyKind.AT_ROUND)


def _when(rounds: int, run: Run) -> str:
    return f"in round {rounds + 1}" if run.begun else "at the start"


def _after(violation: Violation, run: Run) -> str:
    if violation.round == BEFORE_ROUNDS:
        return "at the start"
    where = f"in round {violation.round + 1}"
    if violation.kind is ViolationKind.CONTRACT:
        return f"{where}, by the model of robot {violation.robot}"
    if violation.robot is None:
        return f"at the end of round {violation.round + 1}"
    ran = run.configuration.robots[violation.robot].ran
    events = run.system.agent(violation.robot).events
    did = "skipped" if ran == NO_EVENT else f"ran {events[int(str(ran))].name}"
    return f"{where}, after robot {violation.robot} {did}"


def _span_of(violation: Violation, run: Run) -> Span:
    program = run.system.program
    if violation.kind is ViolationKind.PROPERTY:
        return next(p.span for p in program.properties if p.name == violation.name)
    contracts = (c for a in program.agents for m in a.modules for c in m.contracts)
    return next(c.span for c in contracts if c.name == violation.name)
