"""Loading of programs and configurations from a command's files and flags."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping

from msgspec import Struct

from koord.api.fitting import FitRequest, Fitted, beside, fit, read_configuration
from koord.api.programs import CheckReport, Program, check, no_program
from koord.api.results import ArgumentError
from koord.cli.arguments import settings
from koord.cli.diagnostics import DiagnosticReport
from koord.cli.files import DASH, name_of, read_program
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


def fit_request(
    arguments: argparse.Namespace,
    report: DiagnosticReport,
    robots: int | None = None,
    seed: int | None = None,
    *,
    located: bool = False,
) -> FitRequest | None:
    """Make the request from flags; diagnostics of the files go to the report."""
    path = arguments.config
    if path is None and arguments.file != DASH:
        path = beside(arguments.file, ".yaml")
    try:
        source = read_program(arguments.file).source
        properties = tuple(read_program(name).source for name in arguments.properties)
        configuration = None
        if path is not None:
            text = read_program(path).source
            site = None if arguments.site is None else read_program(arguments.site).source
            report.add((), *(text, site) if site is not None else (text,))
            configuration = read_configuration(text, site)
        elif arguments.site is not None:
            raise ArgumentError("site", "it adds to a configuration, and there is none")
    except KoordError as error:
        report.add(error.diagnostics)
        return None
    params = settings(arguments.settings)
    length = arguments.delta
    return FitRequest(source, configuration, properties, params, length, robots, seed, located)


def fitted(request: FitRequest, report: DiagnosticReport) -> Fitted | None:
    """Fit program and configuration; diagnostics go to the report."""
    try:
        found = fit(request)
    except ArgumentError:
        raise
    except KoordError as error:
        report.add(error.diagnostics, request.source, *request.properties)
        return None
    report.add(found.warnings)
    return found
