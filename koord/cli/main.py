"""``koord COMMAND …``: finds the command, runs it, and turns what ends it into an exit code.

``koord --help`` has to be quick, so this file imports argparse and nothing else of weight: the
list of commands is data, and a command's own file is imported when the command is named.
"""

from __future__ import annotations

import argparse
import atexit
import errno
import gc
import os
import re
import signal
import sys
import threading
from collections.abc import Sequence
from importlib import import_module
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn, Protocol, TextIO, cast

from koord.cli.exits import Exit
from koord.cli.lazy_resources import load_msgspec, put_off
from koord.version import __version__

if TYPE_CHECKING:
    from _typeshed import SupportsWrite


#: What asks a process to end, and the exit code then. Windows has no SIGHUP.
_CODES = {
    getattr(signal, name): code
    for name, code in (("SIGTERM", Exit.TERMINATED), ("SIGHUP", Exit.HUNG_UP))
    if hasattr(signal, name)
}


class Endings:
    """Within the context, signals that ask the process to end count as Ctrl-C."""

    def __init__(self) -> None:
        self.by: int | None = None  #: the signal that ended it
        self._pid = 0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Endings:
        self._pid = os.getpid()
        if threading.current_thread() is threading.main_thread():
            for number in _CODES:
                # Under nohup a hang-up is to be ignored.
                if signal.getsignal(number) is signal.SIG_DFL:
                    self._before[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)

    def code(self, code: int) -> int:
        """The exit code of the command, given the one that it would have had."""
        if self.by is None or code != Exit.INTERRUPTED:
            return code
        return _CODES[self.by]

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if os.getpid() != self._pid:
            # A process that was forked from this one has nothing to bring to an end.
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
            return
        self.by = number
        interrupted = signal.getsignal(signal.SIGINT)
        if not callable(interrupted):
            raise KeyboardInterrupt
        interrupted(signal.SIGINT, frame)


USAGE = "koord COMMAND [ARGUMENT ...]"

DESCRIPTION = "Check, run and verify programs for teams of robots."

EPILOG = """\
exit codes:
  0    done; what was asked for holds
  1    violated: a property does not hold, a trace is illegal, a layout differs; or not all
       robots have obeyed an order; or something is missing that koord needs
  2    a mistake in the input: a program, a file or a flag
  3    unknown: no verdict within the limits given
  4    vacuous: what was asked for holds, but says less than it seems to
  5    stuck: a robot of a simulated run stands still that is to go somewhere
  70   a mistake in koord itself
  71   too little memory to do anything
  129  ended by SIGHUP, in as good an order as with Ctrl-C
  130  interrupted with Ctrl-C
  143  ended by SIGTERM, in as good an order as with Ctrl-C

`koord COMMAND --help` lists the arguments of a command. NO_COLOR=1 turns colours off."""


class Command(Protocol):
    """The interface of a command's module."""

    def configure(self, parser: argparse.ArgumentParser) -> None:
        """Add the command's arguments to its parser."""

    def main(self, arguments: argparse.Namespace) -> int:
        """Run the command and return its exit code."""


class CommandEntry:
    """A command as ``koord --help`` lists it."""

    def __init__(self, name: str, summary: str) -> None:
        self.name, self.summary = name, summary

    def load(self) -> Command:
        return cast(Command, import_module(f"koord.cli.{self.name.replace('-', '_')}"))


COMMANDS = (
    CommandEntry("new", "make a program with all that belongs to it, to begin from"),
    CommandEntry("check", "find the mistakes in programs"),
    CommandEntry("fmt", "lay programs out"),
    CommandEntry("migrate", "bring programs over to today's forms of the language"),
    CommandEntry("explain", "tell the long story of a diagnostic's code"),
    CommandEntry("verify", "verify the properties of programs, or find a violation"),
    CommandEntry("cache", "show or clear the verdicts that `koord verify --cache` keeps"),
    CommandEntry("run", "run a program by the rules and show each round"),
    CommandEntry("recheck", "settle the obligations of a proof with another solver"),
    CommandEntry("replay", "check a trace rule by rule against its program"),
    CommandEntry("sim", "run a program in a simulated world"),
    CommandEntry("lsp", "serve editors: mistakes, names, completions, verdicts while you type"),
    CommandEntry("compile", "compile a program to Python that robots run"),
    CommandEntry("deploy", "run a program on robots, or as processes on this machine"),
    CommandEntry("estop", "stop robots at once: the e-stop"),
    CommandEntry("order", "tell robots that run to stop, to go on, to land"),
    CommandEntry("heartbeat", "let robots move for as long as this runs, and no longer"),
    CommandEntry("drivers", "list drivers and localisers of vehicles, and what they lack"),
    CommandEntry("conform", "test a driver: all that is taken for granted of drivers"),
    CommandEntry("merge", "make one trace of what deployed robots have told"),
    CommandEntry("config", "check configuration files of runs"),
    CommandEntry("schema", "print the JSON Schema of what koord reads and writes"),
    CommandEntry("check-refinement", "check that compiled programs do what the rules allow"),
    CommandEntry("doctor", "tell what is installed, what is missing, and what that would give"),
    CommandEntry("completion", "print a script by which a shell completes commands"),
)


#: The flags that are called otherwise than the arguments of the public API.
_FLAGS = {"properties": "property"}

#: Numbers that argparse takes for flags, and flags that such a number may stand behind.
_NEGATIVE = r"-(?ai:[0-9.].*|inf(inity)?|nan)"
_FLAG = r"--[a-z][a-z-]*"


class _Layout(argparse.RawDescriptionHelpFormatter):
    """The layout of help: as wide as the terminal.

    argparse asks shutil for the width wherever an argument is added: that loads what unpacks files.
    """

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=_width() - 2)


class Parser(argparse.ArgumentParser):
    """argparse with the project's layout: no abbreviated flags, line ends kept as written."""

    def __init__(self, prog: str, description: str, usage: str | None = None) -> None:
        super().__init__(
            prog=prog,
            usage=usage,
            description=description,
            formatter_class=_Layout,
            allow_abbrev=False,
        )

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse as argparse does, but ``--delta -1/2`` is a flag with a number, as is ``-0.5``."""
        words = list(sys.argv[1:] if args is None else args)
        for at in range(len(words) - 1, 0, -1):
            if not words[at].startswith("-"):
                continue
            if re.fullmatch(_FLAG, words[at - 1]) and re.fullmatch(_NEGATIVE, words[at]):
                words[at - 1 : at + 1] = [f"{words[at - 1]}={words[at]}"]
        return super().parse_known_args(words, namespace)

    def _print_message(self, message: str, file: SupportsWrite[str] | None = None) -> None:
        """Write a message; unlike argparse's own, failures are not kept quiet."""
        if message and file is not None:
            file.write(message)

    def error(self, message: str) -> NoReturn:
        """End with one line that says what is wrong, and where the arguments are listed."""
        from koord.syntax.source import visible

        self.exit(
            Exit.BAD_INPUT,
            f"{self.prog}: error: {visible(message)}\n`{self.prog} --help` lists the arguments.\n",
        )


def _width() -> int:
    """The columns of the terminal, as shutil has them: COLUMNS, or the terminal's, or 80."""
    said = os.environ.get("COLUMNS", "")
    if said.isdecimal() and int(said) > 0:
        return int(said)
    if sys.__stdout__ is None:
        return _USUAL_WIDTH
    try:
        return os.get_terminal_size(sys.__stdout__.fileno()).columns or _USUAL_WIDTH
    except (ValueError, OSError):  # no terminal
        return _USUAL_WIDTH


_USUAL_WIDTH = 80


#: How many more objects there are to be, before Python's garbage collector looks for cycles: most
#: are of modules and programs, which last, and looking at them takes a tenth of a short command.
_COLLECTED_EACH = 50_000


def entry() -> NoReturn:
    """The console script, in a process of its own."""
    global _is_own
    _is_own = True
    gc.disable()
    put_off()
    code = main()
    word = next((word for word in sys.argv[1:] if not word.startswith("-")), "")
    if word in _ENDED_AT_ONCE and threading.active_count() == 1:
        _end_at_once(code)
    sys.exit(code)


#: The commands that leave nothing open: they end without freeing what they are made of, which takes
#: Python as long as to check a program.
_ENDED_AT_ONCE = frozenset({"check", "fmt", "migrate", "explain", "verify"})


def _end_at_once(code: int) -> None:
    """End the process, unless something cannot be written, of which Python says what it can."""
    atexit._run_exitfuncs()
    try:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
    except (OSError, ValueError):
        return
    os._exit(code)


#: Whether this process runs one command and no more: who calls :func:`main` in a process of theirs
#: has it as they want it.
_is_own = False


def _load(command: CommandEntry) -> Command:
    """Load a command; in a process of its own, without what takes long and is not needed.

    The garbage collector begins to work when all is loaded that lasts.
    """
    if not _is_own:
        return command.load()
    load_msgspec()
    loaded = command.load()
    gc.freeze()
    gc.set_threshold(_COLLECTED_EACH, *gc.get_threshold()[1:])
    gc.enable()
    return loaded


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code. No exception leaves, whatever the input."""
    with Endings() as endings:
        return endings.code(_run(argv, endings))


def _run(argv: Sequence[str] | None, endings: Endings) -> int:
    for stream in (sys.stdout, sys.stderr):
        _make_total(stream)
    try:
        code = _dispatch(sys.argv[1:] if argv is None else argv)
        if sys.stdout is not None:
            sys.stdout.flush()
    except BrokenPipeError:
        _abandon(sys.stdout)
        return Exit.PIPE_CLOSED
    except KeyboardInterrupt:
        _complain("koord: interrupted")
        return Exit.INTERRUPTED
    except MemoryError:
        _complain("koord: there is too little memory to go on" + _limit_of_memory())
        return Exit.NO_MEMORY
    except Exception as error:
        if isinstance(error, OSError) and _is_of_output(error):
            _abandon(sys.stdout)
            _complain(f"koord: error: the output cannot be written: {error.strerror}")
            # A terminal that hangs up takes the output with it.
            return Exit.BAD_INPUT if endings.by is None else Exit.INTERRUPTED
        _report_internal(error)
        return Exit.INTERNAL
    return code


def _dispatch(argv: Sequence[str]) -> int:
    """Run the named command. Bad flags and ``--help`` end in argparse's exit."""
    try:
        return _run_command(argv)
    except SystemExit as ending:
        return ending.code if isinstance(ending.code, int) else Exit.OK


def _run_command(argv: Sequence[str]) -> int:
    at = next((i for i, word in enumerate(argv) if not word.startswith("-")), len(argv))
    parser = _top_parser()
    parser.parse_args(argv[:at])
    if at == len(argv):
        parser.print_help(sys.stderr)
        return Exit.BAD_INPUT
    command = next((c for c in COMMANDS if c.name == argv[at]), None)
    if command is None:
        parser.error(_unknown_command(argv[at]))
    module = _load(command)
    own = Parser(f"koord {command.name}", _sentence(command.summary))
    module.configure(own)
    arguments = own.parse_args(argv[at + 1 :])
    from koord.api.results import ArgumentError
    from koord.cli.diagnostics import in_flags, report_error
    from koord.syntax.diagnostics import KoordError

    try:
        return module.main(arguments)
    except ArgumentError as error:
        own.error(f"--{_FLAGS.get(error.argument, error.argument)}: {in_flags(error.message)}")
    except KoordError as error:
        report_error(error, as_json=getattr(arguments, "json", False))
        return Exit.BAD_INPUT
    except argparse.ArgumentTypeError as error:
        own.error(str(error))


def _top_parser() -> Parser:
    width = max(len(command.name) for command in COMMANDS)
    lines = [f"  {command.name:<{width}}  {command.summary}" for command in COMMANDS]
    parser = Parser("koord", "\n".join([DESCRIPTION, "", "commands:", *lines]), USAGE)
    parser.epilog = EPILOG
    parser.add_argument("--version", action="version", version=f"koord {__version__}")
    return parser


def _sentence(summary: str) -> str:
    return f"{summary[0].upper()}{summary[1:]}."


def _unknown_command(word: str) -> str:
    from difflib import get_close_matches

    near = get_close_matches(word, [command.name for command in COMMANDS], n=1)
    known = ", ".join(command.name for command in COMMANDS)
    cure = f"did you mean {near[0]}?" if near else f"the commands are {known}"
    return f"there is no command {word!r}; {cure}"


def _make_total(stream: TextIO | None) -> None:
    """Let a stream take any text: what its encoding lacks is written as an escape."""
    reconfigure = getattr(stream, "reconfigure", None)
    if reconfigure is not None:
        reconfigure(errors="backslashreplace")


def _abandon(stream: TextIO | None) -> None:
    """Point a stream that cannot be written at nothing, so that the flush at exit is silent."""
    if stream is None:
        return
    try:
        with open(os.devnull, "w", encoding="utf-8") as nothing:
            os.dup2(nothing.fileno(), stream.fileno())
    except (OSError, ValueError):
        return  # not a real file: nothing is flushed to it at exit


#: What writing to a full disk, a file over its limit, or a closed descriptor raises.
_OUTPUT_ERRORS = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF})


def _is_of_output(error: OSError) -> bool:
    """Return whether the standard output failed; errors of files carry the file's name."""
    return error.filename is None and error.errno in _OUTPUT_ERRORS


def _report_internal(error: Exception) -> None:
    from koord.cli.terminal import is_debugging

    if is_debugging():
        import traceback

        traceback.print_exc()
    version = ".".join(map(str, sys.version_info[:3]))
    story = " ".join(str(error).split())[:200]
    _complain(
        f"koord: internal error: {type(error).__name__}: {story} "
        f"[koord {__version__}, Python {version}, {sys.platform}]. This is a mistake in koord: "
        "please report it with the input that shows it; KOORD_DEBUG=1 shows the traceback."
    )


def _limit_of_memory() -> str:
    """The memory limit of this process, in a form that could be raised."""
    try:
        from resource import RLIM_INFINITY, RLIMIT_AS, getrlimit
    except ImportError:
        return ""
    limit, _ = getrlimit(RLIMIT_AS)
    if limit == RLIM_INFINITY:
        return ""
    return f": it may have {limit // 1_000_000} MB (`ulimit -v`); most programs need 1,000 MB"


def _complain(line: str) -> None:
    """Write one line to standard error, if that can still be written."""
    try:
        print(line, file=sys.stderr, flush=True)
    except (OSError, ValueError):
        _abandon(sys.stderr)
