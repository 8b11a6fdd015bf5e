"""The frame of the command line: what escapes from a command, and what it ends as."""

from __future__ import annotations

import argparse
import errno
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import IO

import pytest

from koord import __version__
from koord.cli import main as frame
from koord.cli.exits import Exit, gravest
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import whole_file

KOORD = [sys.executable, "-m", "koord"]

PROGRAM = "local:\n  int x = 0\ngo:\n  eff: x = x + 1\n"


def raising(error: BaseException) -> Callable[[argparse.Namespace], int]:
    def run(arguments: argparse.Namespace) -> int:
        raise error

    return run


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """Runs ``koord check FLAGS…`` with a body of the test's own."""

    def run(body: Callable[[argparse.Namespace], int], *flags: str) -> int:
        def configure(parser: argparse.ArgumentParser) -> None:
            parser.add_argument("--json", action="store_true")

        module = SimpleNamespace(configure=configure, main=body)
        monkeypatch.setattr(frame, "import_module", lambda name: module)
        return frame.main(["check", *flags])

    return run


def test_help_lists_commands_and_exit_codes(capsys: pytest.CaptureFixture[str]) -> None:
    assert frame.main(["--help"]) == 0
    shown = capsys.readouterr().out
    for entry in frame.COMMANDS:
        assert entry.name in shown
    for code in Exit:
        assert f"\n  {code.value} " in shown or code is Exit.PIPE_CLOSED


def test_without_a_command_the_help_is_shown_as_an_error(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert frame.main([]) == Exit.BAD_INPUT
    streams = capsys.readouterr()
    assert streams.out == ""
    assert "commands:" in streams.err


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert frame.main(["--version"]) == 0
    assert capsys.readouterr().out == f"koord {__version__}\n"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["chekc"], "there is no command 'chekc'; did you mean check?"),
        (["zzz"], "the commands are new, check, fmt, migrate, explain, verify, cache, run,"),
        (["--colour", "check"], "unrecognized arguments: --colour"),
        (["check"], "the following arguments are required: FILE"),
        (["verify", "--round", "3", "x"], "unrecognized arguments: --round"),
        (["verify", "--robots", "0", "x"], "argument --robots: robots must be from 1 to 10000"),
        (["verify", "--engine", "magic", "x"], "argument --engine: invalid choice: 'magic'"),
        (["verify", "--set", "x", "x"], "argument --set: 'x' has no value; write x=value"),
        (["verify", "--set", "x=1", "--set", "x=2", "x"], "--set gives x two values"),
        (["verify", "-", "-"], "- (standard input) is named twice"),
        (["verify", "a", "b", "--trace", "t"], "--trace takes one program at a time"),
        (["run", "-", "--interactive"], "--interactive reads standard input, and so does -"),
        (["explain", "K000"], "there is no code 'K000'"),
    ],
)
def test_wrong_words_end_with_a_line_and_code_2(
    capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    assert frame.main(words) == Exit.BAD_INPUT
    streams = capsys.readouterr()
    assert streams.out == ""
    assert message in streams.err
    assert "--help` lists the arguments" in streams.err


@pytest.mark.parametrize("name", [entry.name for entry in frame.COMMANDS])
def test_every_command_has_a_help(capsys: pytest.CaptureFixture[str], name: str) -> None:
    assert frame.main([name, "--help"]) == 0
    assert f"usage: koord {name}" in capsys.readouterr().out


def test_diagnostics_that_escape_are_shown(
    command: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    diagnostic = Diagnostic("K901", Severity.ERROR, whole_file("a.krd"), "cannot be read: gone")
    body = raising(KoordError((diagnostic,)))
    assert command(body) == Exit.BAD_INPUT
    assert capsys.readouterr().err == "a.krd: error K901: cannot be read: gone\n1 error\n"
    assert command(body, "--json") == Exit.BAD_INPUT
    assert '"code": "K901"' in capsys.readouterr().out


def test_a_mistake_in_koord_is_one_line(
    command: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("KOORD_DEBUG", raising=False)
    assert command(raising(ZeroDivisionError("a\nb"))) == Exit.INTERNAL
    line = capsys.readouterr().err
    assert line.startswith("koord: internal error: ZeroDivisionError: a b [koord ")
    assert line.count("\n") == 1
    monkeypatch.setenv("KOORD_DEBUG", "1")
    assert command(raising(ZeroDivisionError("a"))) == Exit.INTERNAL
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (KeyboardInterrupt(), Exit.INTERRUPTED, "koord: interrupted"),
        (OSError(errno.ENOSPC, "No space left on device"), Exit.BAD_INPUT, "cannot be written"),
        (OSError(errno.EPERM, "no", "/some/file"), Exit.INTERNAL, "PermissionError"),
        (RecursionError("deep"), Exit.INTERNAL, "RecursionError"),
        (MemoryError(), Exit.NO_MEMORY, "too little memory"),
        (BrokenPipeError(), Exit.PIPE_CLOSED, ""),
    ],
)
def test_what_escapes_ends_as_a_code(
    command: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    code: Exit,
    message: str,
) -> None:
    monkeypatch.setattr(frame, "_abandon", lambda stream: None)
    assert command(raising(error)) == code
    assert message in capsys.readouterr().err


def test_the_gravest_code_wins() -> None:
    assert gravest([Exit.OK, Exit.UNKNOWN, Exit.VIOLATED]) is Exit.VIOLATED
    assert gravest([Exit.VIOLATED, Exit.BAD_INPUT]) is Exit.BAD_INPUT
    assert gravest([Exit.OK, Exit.UNKNOWN]) is Exit.UNKNOWN
    assert gravest([]) is Exit.OK


# --- as a process of its own ----------------------------------------------------------------------


@contextmanager
def pipe_without_reader() -> Iterator[int]:
    reading, writing = os.pipe()
    os.close(reading)
    try:
        yield writing
    finally:
        os.close(writing)


def with_output(
    output: int | IO[bytes], words: list[str], unbuffered: str
) -> subprocess.CompletedProcess[bytes]:
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    return subprocess.run(
        [*KOORD, *words], stdout=output, stderr=subprocess.PIPE, timeout=60, env=environment
    )


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("words", [["--help"], ["explain"]])
def test_a_closed_pipe_is_no_traceback(words: list[str], unbuffered: str) -> None:
    with pipe_without_reader() as pipe:
        done = with_output(pipe, words, unbuffered)
    assert done.returncode == Exit.PIPE_CLOSED
    assert done.stderr == b""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("words", [["--help"], ["explain"]])
def test_a_full_disk_is_no_traceback(words: list[str], unbuffered: str) -> None:
    with open("/dev/full", "wb") as full:
        done = with_output(full, words, unbuffered)
    assert done.returncode == Exit.BAD_INPUT
    assert done.stderr == b"koord: error: the output cannot be written: No space left on device\n"


def test_an_encoding_without_the_letters_is_no_traceback(tmp_path: Path) -> None:
    path = tmp_path / "ä.krd"
    path.write_text("local:\n  int ≤\n", encoding="utf-8")
    done = subprocess.run(
        [*KOORD, "check", str(path)],
        capture_output=True,
        timeout=60,
        env={**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "1"},
    )
    assert done.returncode == Exit.BAD_INPUT
    assert b"error K" in done.stdout
    assert b"\\u2264" in done.stdout
    assert done.stderr == b""


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_ctrl_c_ends_with_130(tmp_path: Path) -> None:
    pipe = tmp_path / "endless.krd"
    os.mkfifo(pipe)
    # What runs these tests in the background may ignore Ctrl-C, and a process inherits that.
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    command = [*KOORD, "check", str(pipe)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, preexec_fn=heard) as process:
        with open(pipe, "wb"):  # opens when the command has begun to read
            process.send_signal(signal.SIGINT)
            assert process.wait(60) == Exit.INTERRUPTED
        assert process.stderr is not None
        assert process.stderr.read() == b"koord: interrupted\n"


#: What a command in a process of its own leaves to be done at its end.
_ENDING = """
import atexit, sys, threading
from koord.cli.main import entry

atexit.register(print, "at the end")
if sys.argv.pop(1) == "beside":
    # In one piece, whatever else is being written.
    threading.Timer(0.2, sys.stdout.write, ["\\nbeside\\n"]).start()
entry()
"""


@pytest.mark.parametrize("beside", ["alone", "beside"])
@pytest.mark.parametrize("words", [("explain", "K204"), ("explain", "K999"), ("config",)])
def test_what_is_to_be_done_at_the_end_is_done(beside: str, words: tuple[str, ...]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _ENDING, beside, *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == (Exit.OK if "K204" in words else Exit.BAD_INPUT)
    lines = done.stdout.splitlines()
    assert lines[-1] == "at the end"
    assert ("beside" in lines) is (beside == "beside")
