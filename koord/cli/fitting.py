"""From the files and flags of a command to a program with its configuration."""

from __future__ import annotations

import argparse

from koord.api.fitting import FitRequest, Fitted, beside, fit, read_configuration
from koord.api.results import ArgumentError
from koord.cli.arguments import settings
from koord.cli.diagnostics import DiagnosticReport
from koord.cli.files import DASH, read_program
from koord.syntax.diagnostics import KoordError


def fit_request(
    arguments: argparse.Namespace,
    report: DiagnosticReport,
    robots: int | None = None,
    seed: int | None = None,
) -> FitRequest | None:
    """What the flags ask for; what is wrong with the files goes to the report."""
    path = arguments.config
    if path is None and arguments.file != DASH:
        path = beside(arguments.file, ".yaml")
    try:
        source = read_program(arguments.file).source
        properties = tuple(read_program(name).source for name in arguments.properties)
        configuration = None
        if path is not None:
            text = read_program(path).source
            report.add((), text)
            configuration = read_configuration(text)
    except KoordError as error:
        report.add(error.diagnostics)
        return None
    params = settings(arguments.settings)
    return FitRequest(source, configuration, properties, params, arguments.delta, robots, seed)


def fitted(request: FitRequest, report: DiagnosticReport) -> Fitted | None:
    """Program and configuration together; what does not suit goes to the report."""
    try:
        found = fit(request)
    except ArgumentError:
        raise
    except KoordError as error:
        report.add(error.diagnostics, request.source, *request.properties)
        return None
    report.add(found.warnings)
    return found
