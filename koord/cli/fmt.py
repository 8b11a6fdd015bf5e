"""``koord fmt FILE…``: format programs in place, atomically."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from enum import Enum

from msgspec import Struct

from koord.api.documents import format
from koord.api.files import InputFile, write_atomically
from koord.cli.arguments import add_files, check_files
from koord.cli.diagnostics import DiagnosticReport
from koord.cli.differences import difference
from koord.cli.exits import Exit, gravest
from koord.cli.files import DASH, read_program, write_out
from koord.cli.terminal import Style, style_of
from koord.syntax.diagnostics import KoordError


class FormatTask(Enum):
    """The mode of ``koord fmt``: what to do with the formatted text."""

    WRITE = "write"
    CHECK = "check"
    DIFF = "diff"
    CHECK_AND_DIFF = "check and diff"


class LaidOut(Struct, frozen=True):
    """A file and the text it should have."""

    file: InputFile
    text: str

    @property
    def changed(self) -> bool:
        return self.text.encode("utf-8") != self.file.raw


def configure(parser: argparse.ArgumentParser) -> None:
    add_files(parser)
    parser.add_argument(
        "--check", action="store_true", help="change nothing; exit with 1 if a file would change"
    )
    parser.add_argument("--diff", action="store_true", help="change nothing; show what would")
    parser.epilog = (
        "Standard input (-) is laid out to standard output. A file with errors is left as it is.\n"
        "exit codes: 0 done, 1 --check found a file that would change, 2 errors"
    )


def main(arguments: argparse.Namespace) -> int:
    check_files(arguments.files)
    task = _task(arguments.check, arguments.diff)
    report = DiagnosticReport()
    codes = [_format(path, task, report) for path in arguments.files]
    sys.stdout.flush()
    report.print(sys.stderr, as_json=False)
    return gravest(codes)


def _task(check: bool, diff: bool) -> FormatTask:
    if check and diff:
        return FormatTask.CHECK_AND_DIFF
    if check:
        return FormatTask.CHECK
    return FormatTask.DIFF if diff else FormatTask.WRITE


def _format(path: str, task: FormatTask, report: DiagnosticReport) -> Exit:
    try:
        laid_out = _lay_out(path, report)
        if laid_out is None:
            return Exit.BAD_INPUT
        return _carry_out(task, laid_out)
    except KoordError as error:
        report.add(error.diagnostics)
        return Exit.BAD_INPUT


def _lay_out(path: str, report: DiagnosticReport) -> LaidOut | None:
    file = read_program(path)
    try:
        return LaidOut(file, format(file.source))
    except KoordError as error:
        report.add(error.diagnostics, file.source)
        return None


def _carry_out(task: FormatTask, laid_out: LaidOut) -> Exit:
    path = laid_out.file.path
    if task is FormatTask.WRITE:
        if path == DASH:
            write_out(laid_out.text)
        elif laid_out.changed:
            write_atomically(path, laid_out.text.encode("utf-8"))
            print(f"{laid_out.file.source.name}: laid out")
        return Exit.OK
    if not laid_out.changed:
        return Exit.OK
    if task in (FormatTask.DIFF, FormatTask.CHECK_AND_DIFF):
        for line in _diff(laid_out, style_of(sys.stdout)):
            print(line)
    if task is FormatTask.CHECK:
        print(f"{laid_out.file.source.name}: would be laid out anew")
    return Exit.OK if task is FormatTask.DIFF else Exit.VIOLATED


def _diff(laid_out: LaidOut, style: Style) -> Iterator[str]:
    name = laid_out.file.source.name
    old = laid_out.file.source.text
    if old == laid_out.text:
        yield f"{name}: only line ends or a byte-order mark would change"
        return
    yield from difference(name, old, laid_out.text, "laid out", style)
