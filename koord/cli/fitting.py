"""Reading of a program and its configuration from a command's files and flags.

It is apart from :mod:`koord.cli.inputs`, since what reads configurations takes a while to load.
"""

from __future__ import annotations

import argparse

from koord.api.fitting import (
    FitRequest,
    Fitted,
    beside,
    configuration_of_scene,
    fit,
    read_configuration,
)
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
    *,
    located: bool = False,
    scene: str | None = None,
) -> FitRequest | None:
    """Make the request from flags; diagnostics of the files go to the report.

    ``scene`` is the file that says where robots begin, and which, without a configuration.
    """
    path = arguments.config
    if path is None and arguments.file != DASH:
        path = beside(arguments.file, ".yaml")
    try:
        source = read_program(arguments.file).source
        properties = tuple(read_program(name).source for name in arguments.properties)
        configuration = None
        placed = None if scene is None else read_program(scene).source
        if placed is not None:
            report.add((), placed)
        if path is not None:
            text = read_program(path).source
            site = None if arguments.site is None else read_program(arguments.site).source
            report.add((), *(text, site) if site is not None else (text,))
            configuration = read_configuration(text, site, placed)
        elif placed is not None and arguments.site is None:
            configuration = configuration_of_scene(placed)
        elif arguments.site is not None:
            raise ArgumentError("site", "it adds to a configuration, and there is none")
        if configuration is not None and placed is not None:
            report.add((), *configuration.document.sources)
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
