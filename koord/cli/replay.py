"""``koord replay trace.json``: check a trace rule by rule, and name the first illegal step."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from fractions import Fraction
from typing import assert_never

from msgspec import Struct
from msgspec.structs import replace

from koord.api.files import InputFile
from koord.api.rerun import rerun_dict
from koord.api.traces import read_trace
from koord.cli import departures
from koord.cli.arguments import add_json, check_files, number
from koord.cli.diagnostics import report_error
from koord.cli.exits import Exit
from koord.cli.files import name_of, read_program, read_written
from koord.cli.tables import Rounds, Table, repeats
from koord.cli.terminal import Paint, Style, style_of, visible
from koord.refinement.compiled_replay import Departure, rerun
from koord.sampling.policies import Taken
from koord.semantics.recordings import Step
from koord.syntax.diagnostics import KoordError
from koord.traces.names import Names
from koord.traces.replay import Refused, Replayed, replay
from koord.traces.trace import BEFORE_ROUNDS, Trace, Violation, ViolationKind

#: Raised when the JSON changes in a way that its readers must know of.
JSON_VERSION = 1


class Request(Struct, frozen=True):
    """Which trace is to be checked, and how the answer is shown."""

    name: str
    raw: bytes
    program: InputFile | None  #: instead of the one that the trace holds
    as_json: bool
    show: bool = False
    slack: Fraction | None = None  #: None: what the trace says
    compiled: bool = False  #: whether the compiled program is to do the same


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "trace", metavar="TRACE", help="a trace that koord wrote; - is standard input"
    )
    parser.add_argument(
        "--program", metavar="FILE", help="the program to replay it with (the one in the trace)"
    )
    parser.add_argument("--show", action="store_true", help="show the rounds as a table")
    parser.add_argument(
        "--slack",
        metavar="S",
        type=_slack,
        help="let floats be off by so much in assumptions and contracts (as the trace says: traces "
        "of vehicles say how far these may be off); 0 takes them at their word",
    )
    parser.add_argument(
        "--compiled",
        action="store_true",
        help="have the compiled program run it, too, and compare state for state (floats up to "
        "rounding if the trace has exact numbers)",
    )
    add_json(parser, "the answer")
    parser.epilog = (
        "exit codes: 0 every step is legal, 1 a step is not or the compiled program does something "
        "else, 2 errors in the input"
    )


def _slack(text: str) -> Fraction:
    amount = number(text)
    if amount < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is less than 0")
    return amount


def main(arguments: argparse.Namespace) -> int:
    given = arguments.program
    check_files([arguments.trace, *([given] if given is not None else [])])
    return _replay(
        Request(
            name=name_of(arguments.trace),
            raw=read_written(arguments.trace),
            program=read_program(given) if given is not None else None,
            as_json=arguments.json,
            show=arguments.show,
            slack=arguments.slack,
            compiled=arguments.compiled,
        )
    )


def _replay(request: Request) -> Exit:
    given = request.program.source if request.program is not None else None
    try:
        trace = read_trace(request.raw, request.name, given)
    except KoordError as error:
        sources = [given] if given is not None else []
        report_error(error, as_json=request.as_json, sources=sources)
        return Exit.BAD_INPUT
    if request.slack is not None:
        trace = replace(trace, slack=request.slack)
    shown = _Shown(trace) if request.show and not request.as_json else None
    found = replay(_loosened(trace), shown.step if shown is not None else _unseen)
    if shown is not None:
        shown.close()
    compared = request.compiled and found.refused is None
    departure = rerun(trace) if compared else None
    if request.as_json:
        told = as_json(trace, found)
        told["compiled"] = rerun_dict(departure, first=0) if compared else None
        json.dump(told, sys.stdout, indent=2)
        print()
    else:
        for line in verdict(request.name, trace, found, style_of(sys.stdout)):
            print(line)
        if compared:
            for line in departures.lines(departure):
                print(line)
    return (
        Exit.OK if found.refused is None and not isinstance(departure, Departure) else Exit.VIOLATED
    )


def _loosened(trace: Trace) -> Trace:
    """The trace, of a program whose assumptions and contracts have the trace's slack."""
    if not trace.slack:
        return trace
    from koord.runtime.compile.slack import loosened

    program = loosened(trace.system.program, trace.slack)
    return replace(trace, system=replace(trace.system, program=program))


class _Shown:
    """Shows the rounds of a trace while it is replayed."""

    def __init__(self, trace: Trace) -> None:
        self._rounds = Rounds(Table(Names(trace.system), style_of(sys.stdout)))

    def step(self, step: Step) -> None:
        self._rounds.show(Taken(step))

    def close(self) -> None:
        self._rounds.close()
        print()


def _unseen(step: Step) -> None:
    """Without --show nobody looks at the steps."""


def verdict(name: str, trace: Trace, found: Replayed, style: Style) -> Iterator[str]:
    """What a replay found, in words."""
    refused = found.refused
    if refused is None:
        good = style.paint("legal", Paint.ADDED)
        rounds = f"{found.rounds} round{'' if found.rounds == 1 else 's'}"
        yield (
            f"{visible(name)}: {good}: {found.steps} steps, {rounds}, {trace.numbers.value} numbers"
        )
        yield f"  a run of {visible(str(trace.problem))}"
        yield from _end(trace)
        if trace.cut_off:
            yield f"  the file is cut off: what the run did after {rounds} is not known"
    else:
        bad = style.paint(f"not legal by {refused.rule}", Paint.ERROR)
        yield f"{visible(name)}: {_where(refused)}: {bad}"
        yield f"  a run of {visible(str(trace.problem))}"
        yield f"  {visible(refused.reason)}"
        yield from departures.told_apart(refused.differences, "by the rules", "recorded")
    if trace.slack:
        how = f"{float(trace.slack):g}"
        yield f"  with a slack of {how} in assumptions and contracts, as vehicles keep them"
    if found.trusted:
        names = ", ".join(found.trusted)
        yield f"  taken on trust, since all values of a type cannot be tried: {names}"


def _end(trace: Trace) -> Iterator[str]:
    """How the run of a legal trace ends, if not by itself."""
    fault = trace.configurations[-1].fault
    if fault is not None:
        whose = "" if fault.robot is None else f" of robot {fault.robot}"
        yield f"  it ends in a fault{whose}: {fault.kind.value} ({visible(str(fault.span))})"
    if trace.recording.loop is not None:
        yield f"  {repeats(trace.recording)}, and every robot and lock is dealt with fairly"
    if trace.violation is not None:
        yield f"  it {_does(trace.violation)}, as it says"


def _does(violation: Violation) -> str:
    """What a run that ends in a violation does, in words."""
    name = visible(violation.name)
    match violation.kind:
        case ViolationKind.PROPERTY:
            return f"breaks {name}"
        case ViolationKind.CONTRACT:
            return f"breaks contract {name}"
        case ViolationKind.LOST_UPDATE:
            return f"loses an update of {name}"
    assert_never(violation.kind)


def _where(refused: Refused) -> str:
    step = refused.step
    if step.round == BEFORE_ROUNDS:
        return "the start"
    where = f"round {step.round + 1}"
    if step.robot is None:
        return f"{where}, the environment's turn"
    return f"{where}, robot {step.robot}, " + (f"event {step.event}" if step.event else "a skip")


def as_json(trace: Trace, found: Replayed) -> dict[str, object]:
    """What a replay found, as ``--json`` prints it; rounds count from 0, as in traces."""
    refused = found.refused
    return {
        "version": JSON_VERSION,
        "program": trace.problem.texts[0],
        "problem": trace.problem.document(),
        "legal": refused is None,
        "steps": found.steps,
        "rounds": found.rounds,
        "refused": None
        if refused is None
        else {
            "rule": refused.rule,
            "round": refused.step.round,
            "robot": refused.step.robot,
            "event": refused.step.event,
            "reason": refused.reason,
            "differences": [
                {"robot": c.robot, "location": c.name, "expected": c.old, "recorded": c.new}
                for c in refused.differences
            ],
        },
        "slack": float(trace.slack),
        "trusted": list(found.trusted),
        "cut_off": trace.cut_off,
    }
