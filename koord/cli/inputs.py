"""Loading of programs from a command's files and flags."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping

from msgspec import Struct

from koord.api.programs import CheckReport, Program, check, no_program
from koord.cli.arguments import settings
from koord.cli.diagnostics import DiagnosticReport
from koord.cli.files import name_of, read_program
from koord.syntax.diagnostics import KoordError
from koord.syntax.literals import ParamValue
from koord.syntax.source import Source


class ReadOptions(Struct, frozen=True):
    """The options for reading programs: values of params, and further properties."""

    params: Mapping[str, ParamValue]
    properties: tuple[Source, ...]

    @staticmethod
    def of(arguments: argparse.Namespace) -> ReadOptions:
        """Read ``--set`` and ``--with``. Raises KoordError and ArgumentTypeError."""
        properties = tuple(read_program(path).source for path in arguments.properties)
        return ReadOptions(settings(arguments.settings), properties)


def load_programs(
    paths: Iterable[str], reading: ReadOptions, report: DiagnosticReport
) -> tuple[Program, ...]:
    """Load programs; diagnostics go to the report.

    Left out are those with errors, and files of properties alone, which count as one.
    """
    programs = []
    for path in paths:
        before = report.errors
        found = check_file(path, reading, report)
        if found is not None and found.program is not None:
            programs.append(found.program)
        elif report.errors == before:
            report.add((no_program(name_of(path)),))
    return tuple(programs)


def check_file(path: str, reading: ReadOptions, report: DiagnosticReport) -> CheckReport | None:
    """Load and check one file, reporting its diagnostics; None if it cannot be read."""
    try:
        source = read_program(path).source
    except KoordError as error:
        report.add(error.diagnostics)
        return None
    found = check(source, params=reading.params, properties=reading.properties)
    report.add(found.diagnostics, source, *reading.properties)
    return found
