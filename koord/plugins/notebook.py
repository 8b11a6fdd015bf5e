"""The magic of notebooks: a cell is a program that is checked, verified, run or simulated.

%load_ext koord

%%koord verify --robots 3 --as report
local:
    int x = 0
...
"""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable, Mapping
from typing import Any

from IPython.core.error import UsageError
from IPython.core.interactiveshell import InteractiveShell

from koord.api.programs import CheckReport, Program, check
from koord.api.results import ArgumentError, Result
from koord.api.robots import system_of
from koord.api.run import HowToRun, Policy, RunReport, session_of
from koord.api.simulation import simulate
from koord.api.stories import of_verdict
from koord.api.traces import Trace
from koord.api.verdicts import Verdict
from koord.api.verify import Question, verify_each
from koord.cli.arguments import add_bounds, add_settings, seconds, settings
from koord.cli.diagnostics import in_flags, render
from koord.cli.files import read_program
from koord.cli.verify import add_question, options_of
from koord.plugins.flags import FlagError, Flags
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source

#: The name of a cell's program, where none is given.
CELL = "cell.krd"


class NoProgramError(Exception):
    """Raised where a text has errors, or properties alone; the report has the diagnostics."""

    def __init__(self, report: CheckReport) -> None:
        super().__init__(repr(report))
        self.report = report


def load(shell: InteractiveShell) -> None:
    """Give a shell the magics ``%koord`` and ``%%koord``, and pages of runs that break claims."""

    def koord(line: str, cell: str | None = None) -> Result:
        """Check, verify, run or simulate a program: ``%%koord verify --robots 3``."""
        return answer(shell, line, cell)

    formatters: Any = shell.display_formatter
    formatters.formatters["text/html"].for_type(Verdict, _shown)
    register: Any = shell.register_magic_function  # whose type is that of a method
    register(koord, "line_cell", "koord")


def _shown(verdict: Verdict) -> str:
    """A verdict for a notebook: the page of the run that breaks the claim, if there is one."""
    told = next(of_verdict(verdict), None)
    return verdict._repr_html_() if told is None else told._repr_html_()


def answer(shell: InteractiveShell, line: str, cell: str | None) -> Result:
    """What a magic shows. Raises UsageError, which is shown as one line."""
    try:
        words = shlex.split(line)
        name = words.pop(0) if words and words[0] in _COMMANDS else "verify"
        command = _COMMANDS[name]
        arguments = _read(name, words, is_cell=cell is not None)
        if cell is None:
            source = read_program(arguments.file).source
        else:
            source = Source(arguments.name, cell)
        try:
            found = command.do(source, arguments)
        except NoProgramError as error:
            found = error.report
    except (FlagError, argparse.ArgumentTypeError, ValueError) as error:
        raise UsageError(f"koord: {error}") from None
    except ArgumentError as error:
        raise UsageError(f"koord: {error.argument}: {in_flags(error.message)}") from None
    except KoordError as error:
        shown = [text for one in error.diagnostics for text in render(one, {})]
        raise UsageError("\n".join(shown)) from None
    if arguments.variable is not None:
        shell.user_ns[arguments.variable] = found
    return found


def _read(name: str, words: list[str], *, is_cell: bool) -> argparse.Namespace:
    """Parse the flags of a magic. Raises FlagError."""
    parser = Flags(f"koord {name}", "")
    if is_cell:
        parser.add_argument("--name", default=CELL)
    else:
        parser.add_argument("file")
    parser.add_argument("--as", dest="variable", type=_variable)
    add_settings(parser)
    _COMMANDS[name].configure(parser)
    return parser.parse_args(words)


def _variable(text: str) -> str:
    if not text.isidentifier():
        raise argparse.ArgumentTypeError(f"{text!r} is no name of a variable")
    return text


def _program(source: Source, arguments: argparse.Namespace) -> Program:
    """The program of a text. Raises NoProgramError and KoordError."""
    report = _checked(source, arguments)
    if report.program is None:
        raise NoProgramError(report)
    return report.program


# --- commands -------------------------------------------------------------------------------------


class _Command:
    """A command of the magic: its flags, and what it does."""

    def __init__(
        self,
        configure: Callable[[argparse.ArgumentParser], None],
        do: Callable[[Source, argparse.Namespace], Result],
    ) -> None:
        self.configure, self.do = configure, do


def _checked(source: Source, arguments: argparse.Namespace) -> CheckReport:
    properties = [read_program(path).source for path in arguments.properties]
    return check(source, params=settings(arguments.settings), properties=properties)


def _verified(source: Source, arguments: argparse.Namespace) -> Result:
    program = _program(source, arguments)
    if len(arguments.robots) > 1:
        raise FlagError("--robots: a cell is about one number of robots")
    (fleet,) = arguments.robots
    system = system_of(program.core, fleet, arguments.delta)
    question = Question(program, system, every_n=fleet.any_number)
    options = options_of(arguments, None)
    (report,) = verify_each([question], options, lambda text: None, lambda: False)
    return report


def _ran(source: Source, arguments: argparse.Namespace) -> Result:
    program = _program(source, arguments)
    if arguments.robots.any_number:
        raise FlagError("--robots: a run needs a number of robots")
    system = system_of(program.core, arguments.robots, arguments.delta)
    how = HowToRun(arguments.rounds, Policy(arguments.policy))
    session = session_of(program, system, how, arguments.seed, None)
    for _ in session.parts():
        pass
    return RunReport(program, Trace(session.recorded()), session.ending)


def _add_run(parser: argparse.ArgumentParser) -> None:
    add_bounds(parser)
    parser.add_argument("--policy", choices=[one.value for one in Policy], default="first")


def _simulated(source: Source, arguments: argparse.Namespace) -> Result:
    program = _program(source, arguments)
    return simulate(
        program,
        arguments.config,
        robots=arguments.robots,
        seed=arguments.seed,
        duration_s=arguments.time,
    )


def _add_simulation(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config")
    parser.add_argument("--robots", type=int)
    parser.add_argument("--seed", type=int)
    parser.add_argument("--time", type=seconds)


_COMMANDS: Mapping[str, _Command] = {
    "check": _Command(lambda parser: None, _checked),
    "verify": _Command(add_question, _verified),
    "run": _Command(_add_run, _ran),
    "sim": _Command(_add_simulation, _simulated),
}
