"""``koord replay trace.json``: check a trace rule by rule, and name the first illegal step."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from fractions import Fraction

from koord.api.files import write_atomically
from koord.api.replay import ReplayReport, replayed
from koord.api.run import TakenStep
from koord.api.traces import read_trace, reloads_of
from koord.cli.arguments import add_html, add_json, check_files, number
from koord.cli.counterexamples import rerun_lines, told_apart
from koord.cli.diagnostics import report_error
from koord.cli.exits import Exit
from koord.cli.files import check_writable, name_of, read_program, read_written
from koord.cli.tables import Rounds, RunTable
from koord.cli.terminal import Paint, Style, style_of, visible
from koord.cli.violations import claim_lines, does
from koord.semantics.recordings import Step
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import counted
from koord.traces.names import Names
from koord.traces.rendering import repeats
from koord.traces.replay import Refused
from koord.traces.trace import BEFORE_ROUNDS, Trace


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
    add_html(parser, "the run turn by turn, up to the first step that is wrong,")
    add_json(parser, "the answer")
    parser.epilog = (
        "exit codes: 0 every step is legal, 1 a step is not, a run of robots breaks a property on "
        "its way, or the compiled program does something else, 2 errors in the input"
    )


def _slack(text: str) -> Fraction:
    amount = number(text)
    if amount < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is less than 0")
    return amount


def main(arguments: argparse.Namespace) -> int:
    check_files([arguments.trace, *([arguments.program] if arguments.program is not None else [])])
    if arguments.html is not None:
        check_writable(arguments.html, (arguments.trace,))
    name, raw = name_of(arguments.trace), read_written(arguments.trace)
    given = None if arguments.program is None else read_program(arguments.program).source
    try:
        trace = read_trace(raw, name, given)
    except KoordError as error:
        sources = [given] if given is not None else []
        report_error(error, as_json=arguments.json, sources=sources)
        return Exit.BAD_INPUT
    shown = _Shown(trace) if arguments.show and not arguments.json else None
    report = replayed(
        trace,
        shown.step if shown is not None else _unseen,
        slack=arguments.slack,
        compiled=arguments.compiled,
    )
    if shown is not None:
        shown.close()
    if arguments.json:
        print(report.to_json())
    else:
        for line in verdict(name, report, style_of(sys.stdout)):
            print(line)
        if report.compared:
            for line in rerun_lines(report.departure):
                print(line)
    if arguments.html is not None:
        from koord.api.html import html

        write_atomically(arguments.html, html(report).encode("utf-8"))
    is_good = report.legal and report.agrees and report.broken is None
    return Exit.OK if is_good else Exit.VIOLATED


class _Shown:
    """A listener that shows the rounds of a trace while it is replayed."""

    def __init__(self, trace: Trace) -> None:
        self._parts = iter(trace.parts)
        self._rounds = self._of_part()

    def _of_part(self) -> Rounds:
        return Rounds(RunTable(Names(next(self._parts).system), style_of(sys.stdout)))

    def step(self, step: Step) -> None:
        if step.rule == "RELOAD":
            self.close()
            print(f"another program goes on before round {step.round + 2}")
            self._rounds = self._of_part()
        self._rounds.show(TakenStep(step))

    def close(self) -> None:
        self._rounds.close()
        print()


def _unseen(step: Step) -> None:
    """Ignore a step: without --show nothing is shown."""


def verdict(name: str, report: ReplayReport, style: Style) -> Iterator[str]:
    """Describe the result of a replay."""
    trace, found, refused = report.trace.recorded, report.found, report.refused
    if refused is None:
        good = style.paint("legal", Paint.ADDED)
        rounds = counted(found.rounds, "round")
        yield (
            f"{visible(name)}: {good}: {found.steps} steps, {rounds}, {trace.numbers.value} numbers"
        )
        yield f"  a run of {visible(str(trace.problem))}"
        yield from _changes(trace)
        yield from claim_lines(report.broken, report.unjudged)
        yield from _end(trace)
        if trace.cut_off:
            yield f"  the file is cut off: what the run did after {rounds} is not known"
    else:
        bad = style.paint(f"not legal by {refused.rule}", Paint.ERROR)
        yield f"{visible(name)}: {_where(refused)}: {bad}"
        yield f"  a run of {visible(str(trace.problem))}"
        yield f"  {visible(refused.reason)}"
        yield from told_apart(refused.differences, "by the rules", "recorded")
    if trace.slack:
        how = f"{float(trace.slack):g}"
        yield f"  with a slack of {how} in assumptions and contracts, as vehicles keep them"
    if found.trusted:
        names = ", ".join(found.trusted)
        yield f"  taken on trust, since all values of a type cannot be tried: {names}"


def _changes(trace: Trace) -> Iterator[str]:
    """Say where the program was changed."""
    rounds = [str(number + 1) for number in reloads_of(trace)]
    if rounds:
        listed = " and ".join([", ".join(rounds[:-1]), rounds[-1]] if rounds[1:] else rounds)
        yield f"  another program goes on before round{'s' * (len(rounds) > 1)} {listed}"


def _end(trace: Trace) -> Iterator[str]:
    """Describe the end of a legal trace, if it is not just the last round."""
    fault = trace.parts[-1].configurations[-1].fault
    if fault is not None:
        whose = "" if fault.robot is None else f" of robot {fault.robot}"
        yield f"  it ends in a fault{whose}: {fault.kind.value} ({visible(str(fault.span))})"
    if trace.recording.loop is not None:
        yield f"  {repeats(trace.recording)}, and every robot and lock is dealt with fairly"
    if trace.violation is not None:
        yield f"  it {does(trace.violation)}, as it says"


def _where(refused: Refused) -> str:
    step = refused.step
    if step.round == BEFORE_ROUNDS:
        return "the start"
    where = f"round {step.round + 1}"
    if step.robot is None:
        return f"{where}, the environment's turn"
    return f"{where}, robot {step.robot}, " + (f"event {step.event}" if step.event else "a skip")
