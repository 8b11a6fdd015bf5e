"""From the files that a command names to core programs, with every diagnostic on the way."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from fractions import Fraction

from msgspec import Struct

from koord.cli.arguments import settings
from koord.cli.diagnostics import Report
from koord.cli.files import name_of, read_program
from koord.syntax import core
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.elaborate.settings import Settings
from koord.syntax.load import load
from koord.syntax.problem import Problem
from koord.syntax.source import Source, whole_file


class Reading(Struct, frozen=True):
    """How programs are to be read: values of their params, and further properties."""

    settings: Settings
    properties: tuple[Source, ...]

    @staticmethod
    def of(arguments: argparse.Namespace) -> Reading:
        """From ``--set`` and ``--with``. Raises KoordError and ArgumentTypeError."""
        chosen = settings(arguments.settings)
        return Reading(
            Settings(chosen), tuple(read_program(path).source for path in arguments.properties)
        )


class LoadedProgram(Struct, frozen=True):
    """A program without errors, the text it comes from, and how that was read."""

    source: Source
    program: core.Program
    reading: Reading

    @property
    def sources(self) -> tuple[Source, ...]:
        """All text that it was made of."""
        return (self.source, *self.reading.properties)

    def problem(self, kinds: tuple[int, ...] | None, delta_s: Fraction | None) -> Problem:
        """What is said of it with such robots (None: with every number of them) and such a round
        (None: as it states).
        """
        names = tuple(source.name for source in self.sources)
        delta_s = self.program.instance.used_delta_s if delta_s is None else delta_s
        return Problem(names, self.program, kinds, delta_s)


def load_programs(
    paths: Iterable[str], reading: Reading, report: Report
) -> tuple[LoadedProgram, ...]:
    """Load programs to work with; what is wrong goes to the report.

    Left out are those with errors, and files of properties alone, which count as one.
    """
    programs = []
    for path in paths:
        before = report.errors
        checked = check_file(path, reading, report)
        if checked is not None and checked.program is not None:
            programs.append(LoadedProgram(checked.source, checked.program, reading))
        elif report.errors == before:
            report.add((no_program(name_of(path)),))
    return tuple(programs)


class Checked(Struct, frozen=True):
    """What a text holds: a program, or none if it is a file of properties or has errors."""

    source: Source
    program: core.Program | None


def check_file(path: str, reading: Reading, report: Report) -> Checked | None:
    """Read and elaborate one file, reporting what is wrong; None if it cannot be read."""
    try:
        source = read_program(path).source
    except KoordError as error:
        report.add(error.diagnostics)
        return None
    elaborated = load(source, reading.settings, reading.properties)
    report.add(elaborated.diagnostics, source, *reading.properties)
    return Checked(source, elaborated.program)


def no_program(name: str) -> Diagnostic:
    """There is nothing to work on in the file of that name."""
    return Diagnostic(
        "K904",
        Severity.ERROR,
        whole_file(name),
        "there is no program in this file, only properties",
        "name a program, and this file behind --with",
    )
