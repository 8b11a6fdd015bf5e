"""``koord run FILE``: a run by the rules, shown round by round; ``--interactive`` picks steps."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator

from msgspec import Struct

from koord.api.files import write_atomically
from koord.api.growing import Growing, part_of, remove_part
from koord.api.programs import Program
from koord.api.progress import CancelledError
from koord.api.results import ArgumentError
from koord.api.robots import system_of
from koord.api.run import Ending, HowToRun, MadeRound, Policy, RunSession, session_of
from koord.api.stepping import Option, Shift, Stepper
from koord.api.traces import Trace, complete_trace
from koord.cli.arguments import (
    add_bounds,
    add_files,
    add_html,
    add_json,
    add_settings,
    add_trace,
    check_files,
)
from koord.cli.diagnostics import DiagnosticReport, place, report_error
from koord.cli.exits import Exit
from koord.cli.files import DASH, check_writable
from koord.cli.inputs import ReadOptions, load_programs
from koord.cli.progress import Interruption
from koord.cli.tables import Rounds, RunTable, ShownStep
from koord.cli.terminal import Paint, Style, style_of, visible
from koord.semantics.configurations import NO_EVENT
from koord.semantics.rounds import IllegalStepError
from koord.syntax.core import PropertyKind
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import counted
from koord.syntax.system import System
from koord.traces.names import Names
from koord.traces.trace import BEFORE_ROUNDS, Numbers, Violation, ViolationKind

HELP = """\
  a number   take that turn; Enter alone takes the first one
  r          let the other robots of this round move as the runtime would
  u          undo the last step
  s          show the whole configuration
  q          quit (so does the end of the input)"""


class Interactive(Struct):
    """A dialogue about a run by hand. ``play`` runs it; then ``stepper`` is its state."""

    stepper: Stepper
    table: RunTable

    def play(self, keep: Callable[[], None]) -> None:
        """Ask and move until the user quits, or the run ends."""
        _tell(*self.table.start(self.stepper.begin()))
        print("h lists what can be typed here")
        while not self.stepper.is_over:
            if not self.stepper.run.waiting:
                self._show(self.stepper.evolve())
                continue
            keep()
            if not self._ask():
                return

    def _ask(self) -> bool:
        """Ask one question and act on the answer; False to quit."""
        print()
        print(self.table.heading(self.stepper.run.round))
        options: list[Option] = []
        for option in self.stepper.options():
            said = f"robot {option.robot}: {option.event or 'skip'}"
            if option.loses:
                print(f"       {said} (its lock is taken)")
                continue
            options.append(option)
            print(f"  {len(options):>3}  {said}")
        answer = _typed(f"which turn (1 to {len(options)}, h)? ")
        match answer:
            case None | "q":
                return False
            case "h" | "?" | "help":
                print(HELP)
            case "u":
                print("undone" if self.stepper.undo() else "there is nothing to undo")
            case "s":
                _tell(*self.table.start(self.stepper.taken[-1]))
            case "r":
                for made in self.stepper.finish_round():
                    self._show(made)
            case "":
                self._make(options[0])
            case _ if answer.isdecimal() and 1 <= int(answer[:9]) <= len(options):
                self._make(options[int(answer[:9]) - 1])
            case _:
                print(f"{answer!r} is none of the numbers; h lists what can be typed here")
        return True

    def _make(self, option: Option) -> None:
        try:
            made = self.stepper.make(option)
        except IllegalStepError as refused:
            print(f"not allowed, by rule {refused.rule}: {refused.reason}")
            return
        self._show(made)

    def _show(self, made: Shift) -> None:
        step = made.taken.step
        lines = list(self.table.rows([ShownStep(step, made.before.configuration, made.taken.lost)]))
        if step.rule == "SKIP" and not lines:
            lines = [f"  {step.robot}  skip"]
        _tell(*lines)


def _tell(*lines: str) -> None:
    for line in lines:
        print(line)


def _typed(question: str) -> str | None:
    """The user's input, or None at its end."""
    try:
        return input(question).strip()
    except EOFError:
        print(file=sys.stdout)
        return None


#: A trace grows so often: a step may take long, and what was before it is to be there then.
_PERIOD_S = 0.05


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
    add_html(parser, "the run turn by turn")
    add_json(parser, "the trace")
    parser.epilog = "exit codes: 0 done, 1 a fault or a violation was met, 2 errors in the input"


def main(arguments: argparse.Namespace) -> int:
    check_files([arguments.file, *arguments.properties])
    if arguments.interactive and arguments.json:
        raise argparse.ArgumentTypeError("--interactive and --json do not go together")
    if arguments.interactive and DASH in (arguments.file, *arguments.properties):
        raise argparse.ArgumentTypeError("--interactive reads standard input, and so does -")
    for path in (arguments.trace, arguments.html):
        if path is not None:
            check_writable(path, (arguments.file, *arguments.properties))
    report = DiagnosticReport()
    programs = load_programs([arguments.file], ReadOptions.of(arguments), report)
    if report.errors and arguments.json:
        report.print(sys.stdout, as_json=True)
    else:
        report.print(sys.stderr, as_json=False)
    if report.errors:
        return Exit.BAD_INPUT
    try:
        return _run(programs[0], arguments)
    except ArgumentError:
        raise
    except KoordError as error:  # of the program, met on the way
        report_error(error, as_json=arguments.json, sources=report.sources.values())
        return Exit.BAD_INPUT


def _run(loaded: Program, arguments: argparse.Namespace) -> Exit:
    system = system_of(loaded.core, arguments.robots, arguments.delta)
    interruption = None if arguments.interactive else Interruption()
    session = session_of(
        loaded,
        system,
        HowToRun(
            arguments.rounds,
            Policy(arguments.policy),
            Numbers(arguments.numbers),
            traced=arguments.json or not (arguments.trace is None is arguments.html),
            recorded=arguments.interactive,
        ),
        arguments.seed,
        None if interruption is None else lambda: interruption.requested,
    )
    if not arguments.json:
        print(_heading(loaded, arguments, system))
    table = RunTable(Names(system), style_of(sys.stdout))
    if interruption is None:
        return _by_hand(arguments, Interactive(Stepper(loaded, session), table))
    with interruption:
        return _by_policy(session, arguments, table)


def _by_policy(session: RunSession, arguments: argparse.Namespace, table: RunTable) -> Exit:
    rounds = None if arguments.json else Rounds(table)
    with Growing(_PERIOD_S) as growing:
        if arguments.trace is not None:
            growing.add(arguments.trace, session.part)
        try:
            for part in session.parts():
                if isinstance(part, MadeRound):
                    growing.grow()
                    if rounds is not None:
                        rounds.show_round(part)
                    continue
                if part.step.robot is None:  # between two rounds
                    growing.grow()
                if rounds is not None:
                    rounds.show(part)
        except CancelledError as cancelled:
            print(f"interrupted {cancelled}", file=sys.stderr)
            return Exit.INTERRUPTED
        finally:
            if rounds is not None:
                rounds.close()
    if session.tracer is not None:
        _keep(Trace(session.recorded()), arguments)
    ending = session.ending
    if ending.interrupted:
        if not arguments.json:
            print(f"\ninterrupted after {counted(ending.rounds, 'round')}")
        return Exit.INTERRUPTED
    if not arguments.json:
        _conclude(session.program, ending)
    return Exit.VIOLATED if ending.broken else Exit.OK


def _by_hand(arguments: argparse.Namespace, session: Interactive) -> Exit:
    stepper = session.stepper

    def keep() -> None:
        """Write the trace anew, as steps may have been undone."""
        if arguments.trace is not None:
            write_atomically(part_of(arguments.trace), stepper.trace().encoded())

    session.play(keep)
    if not (arguments.trace is None is arguments.html):
        _keep(stepper.trace(), arguments, has_grown=False)
    _conclude(stepper.program, stepper.ending)
    return Exit.VIOLATED if stepper.ending.broken else Exit.OK


def _keep(trace: Trace, arguments: argparse.Namespace, *, has_grown: bool = True) -> None:
    if arguments.trace is not None:
        if has_grown:
            complete_trace(arguments.trace, trace.recorded)
        else:
            trace.save(arguments.trace)
        remove_part(arguments.trace)
    if arguments.html is not None:
        from koord.api.html import html

        write_atomically(arguments.html, html(trace).encode("utf-8"))
    if arguments.json:
        sys.stdout.write(trace.encoded().decode("utf-8"))


# --- what is printed ----------------------------------------------------------------------------


def _heading(loaded: Program, arguments: argparse.Namespace, system: System) -> str:
    how = "by hand" if arguments.interactive else f"policy {arguments.policy}"
    problem = loaded.problem(system.kinds, system.delta_s)
    return f"{visible(str(problem))}, {how}, seed {arguments.seed}"


def _conclude(loaded: Program, ending: Ending) -> None:
    for line in conclusion(loaded, ending, style_of(sys.stdout)):
        print(line)


def conclusion(loaded: Program, ending: Ending, style: Style) -> Iterator[str]:
    """Describe the end of a run, with the place in the text that is to blame, if any."""
    fault, violation = ending.fault, ending.violation
    yield ""
    if fault is not None:
        whose = "" if fault.robot is None else f" of robot {fault.robot}"
        when = f"in round {ending.configuration.round + 1}" if ending.begun else "at the start"
        yield f"{style.paint('fault', Paint.ERROR)}: {fault.kind.value}{whose}, {when}"
    elif violation is not None:
        said = style.paint("violated", Paint.ERROR)
        yield f"{said}: {violation.name} does not hold, {_after(violation, ending)}"
    else:
        ended = ", and then every robot has stopped" if ending.all_stopped else ""
        invariants = sum(p.kind in _SAFETY for p in ending.system.program.properties)
        held = f"; {counted(invariants, 'invariant')} held" if invariants else ""
        done = f"{style.paint('done', Paint.ADDED)}: {counted(ending.rounds, 'round')}"
        yield f"{done}{ended}, no fault{held}"
    if ending.place is not None:
        yield from place(loaded.sources, ending.place, style)


_SAFETY = (PropertyKind.INVARIANT, PropertyKind.AT_ROUND)


def _after(violation: Violation, ending: Ending) -> str:
    if violation.round == BEFORE_ROUNDS:
        return "at the start"
    where = f"in round {violation.round + 1}"
    if violation.kind is ViolationKind.CONTRACT:
        return f"{where}, by the model of robot {violation.robot}"
    if violation.robot is None:
        return f"at the end of round {violation.round + 1}"
    ran = ending.configuration.robots[violation.robot].ran
    events = ending.system.agent(violation.robot).events
    did = "skipped" if ran == NO_EVENT else f"ran {events[int(str(ran))].name}"
    return f"{where}, after robot {violation.robot} {did}"
