"""``koord migrate FILE…``: bring programs over to today's forms, and say what was done and why."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator

from msgspec import Struct

from koord.api.files import write_atomically
from koord.api.migrate import Migration, migrate
from koord.api.results import MIGRATION_VERSION
from koord.cli.arguments import add_files, add_json, check_files
from koord.cli.diagnostics import DiagnosticReport, report_error
from koord.cli.differences import difference
from koord.cli.exits import Exit
from koord.cli.files import DASH, read_program, write_out
from koord.cli.terminal import Paint, Style, style_of
from koord.syntax.diagnostics import Diagnostic, KoordError
from koord.syntax.source import counted, visible


class _File(Struct, frozen=True):
    """A file of the command line, migrated; ``line_end`` is how its lines end."""

    path: str
    migration: Migration
    line_end: str = "\n"

    @property
    def text(self) -> str:
        """The text that came out, with the line ends of what went in."""
        return self.migration.text.replace("\n", self.line_end)


def configure(parser: argparse.ArgumentParser) -> None:
    add_files(parser)
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--write", action="store_true", help="change the files, each at once")
    mode.add_argument(
        "--diff", action="store_true", help="change nothing; show what would change (the default)"
    )
    parser.add_argument(
        "--stub",
        action="store_true",
        help="declare the functions that nobody declares, at the end: extern, with any answer",
    )
    add_json(parser, "the texts that come out, the steps, and what is left to do")
    parser.epilog = (
        "Comments and layout stay, and a program means what it did. Standard input (-) is written\n"
        "to standard output with --write. What nobody but a person can do is told with its line.\n"
        "exit codes: 0 all is in today's forms, or would be with --write; 2 errors are left"
    )


def main(arguments: argparse.Namespace) -> int:
    check_files(arguments.files)
    found: list[_File] = []
    try:
        found.extend(_migrated(path, stub=arguments.stub) for path in arguments.files)
    except KoordError as error:
        report_error(error, as_json=arguments.json)
        return Exit.BAD_INPUT
    if arguments.write:
        for file in found:
            _write(file)
    if arguments.json:
        files = [file.migration.to_dict() for file in found]
        json.dump({"version": MIGRATION_VERSION, "files": files}, sys.stdout, indent=2)
        print()
    else:
        _show(found, write=arguments.write)
    return Exit.BAD_INPUT if any(file.migration.errors for file in found) else Exit.OK


def _migrated(path: str, *, stub: bool) -> _File:
    file = read_program(path)
    line_end = "\r\n" if b"\r\n" in file.raw else "\n"
    return _File(path, migrate(file.source, stub=stub), line_end)


def _write(file: _File) -> None:
    if file.path != DASH and file.migration.changed:
        write_atomically(file.path, file.text.encode("utf-8"))


def _show(found: list[_File], *, write: bool) -> None:
    style = style_of(sys.stdout)
    report = DiagnosticReport()
    for file in found:
        migration = file.migration
        name = migration.source.name
        if write and file.path == DASH:
            write_out(file.text)
            stream = sys.stderr
        else:
            stream = sys.stdout
            if migration.changed and not write:
                text = migration.source.text
                for line in difference(name, text, migration.text, "today", style):
                    print(line)
        for line in _explained(migration, style, write=write):
            print(line, file=stream)
        report.add(migration.errors, migration.migrated)
    sys.stdout.flush()
    report.print(sys.stderr, as_json=False)


def _explained(migration: Migration, style: Style, *, write: bool) -> Iterator[str]:
    """The lines that say what was done, step by step."""
    name = visible(migration.source.name)
    for step in migration.steps:
        yield _step(step, style)
    if not migration.steps:
        yield f"{name}: nothing to bring over"
    else:
        done = "brought over" if write else "to be brought over"
        yield f"{name}: {counted(len(migration.steps), 'old form')} {done}"


def _step(step: Diagnostic, style: Style) -> str:
    place = f"{visible(step.span.file)}:{step.span.line}:{step.span.column}"
    cure = "" if step.hint is None else f": {step.hint}"
    return f"{style.paint(place, Paint.BOLD)}: {visible(f'{step.message}{cure}')}"
