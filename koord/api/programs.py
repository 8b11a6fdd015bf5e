"""Loading and checking of programs from files or texts."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from koord.api.files import read_program
from koord.api.results import ArgumentError, Result, diagnostics_dict, html_table
from koord.api.robots import exact_number
from koord.syntax import core
from koord.syntax import load as texts
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.elaboration.settings import Settings
from koord.syntax.literals import ParamValue
from koord.syntax.problem import Problem, told
from koord.syntax.source import Source, normalise, whole_file

#: A text to read: the name of its file, or the text itself with a name.
Text: TypeAlias = str | os.PathLike[str] | Source

#: A value of a ``param``, as Python has it: a float is the decimal that it is written as.
Value: TypeAlias = "int | float | Fraction | bool | str | Iterable[Value]"


class Program(Struct, frozen=True, repr_omit_defaults=True):
    """A program without errors: its text, its core program, and its settings.

    ``settings`` are the values of its params, ``properties`` the files of further properties,
    ``warnings`` what may be wrong all the same.
    """

    source: Source
    core: core.Program
    settings: Settings
    properties: tuple[Source, ...] = ()
    warnings: tuple[Diagnostic, ...] = ()

    @property
    def name(self) -> str:
        """The name of its file."""
        return self.source.name

    @property
    def sources(self) -> tuple[Source, ...]:
        """All texts that it was made of."""
        return (self.source, *self.properties)

    def problem(self, kinds: tuple[int, ...] | None, delta_s: Fraction | None) -> Problem:
        """The program with robots (None: every number of them) and a round's length.

        A ``delta_s`` of None is the length that the program states.
        """
        names = tuple(source.name for source in self.sources)
        delta_s = self.core.instance.used_delta_s if delta_s is None else delta_s
        return Problem(names, self.core, kinds, delta_s)

    def __repr__(self) -> str:
        events = sum(len(agent.events) for agent in self.core.agents)
        properties = ", ".join(stated.name for stated in self.core.properties) or "none"
        given = "".join(f", {told(param)}" for param in self.core.parameters)
        return f"<Program {self.name}: {events} events, properties: {properties}{given}>"


#: What functions of the API take as a program: one that is loaded, or what :func:`load` takes.
Loadable: TypeAlias = Program | Text


class CheckReport(Result, frozen=True):
    """The diagnostics of a text; ``program`` is None if it has errors, or properties alone."""

    source: Source
    properties: tuple[Source, ...]
    diagnostics: tuple[Diagnostic, ...]
    program: Program | None

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        """The errors, which prevent the use of the program."""
        return tuple(d for d in self.diagnostics if d.severity is Severity.ERROR)

    @property
    def warnings(self) -> tuple[Diagnostic, ...]:
        """The warnings."""
        return tuple(d for d in self.diagnostics if d.severity is Severity.WARNING)

    def to_dict(self) -> dict[str, object]:
        """The diagnostics as plain data, as ``koord check --json`` prints them."""
        return diagnostics_dict(self.diagnostics)

    def __repr__(self) -> str:
        lines = [f"{d.span}: {d.severity.value} {d.code}: {d.message}" for d in self.diagnostics]
        said = f"{len(self.errors)} errors, {len(self.warnings)} warnings"
        return "\n".join([f"<CheckReport {self.source.name}: {said}>", *lines])

    def _repr_html_(self) -> str:
        rows = [(d.span, d.severity.value, d.code, d.message, d.hint) for d in self.diagnostics]
        columns = ("place", "severity", "code", "message", "help")
        return html_table(f"{self.source.name}: {len(rows)} diagnostics", columns, rows)


def load(
    text: Text, *, params: Mapping[str, Value] | None = None, properties: Iterable[Text] = ()
) -> Program:
    """Load the program in a file, or in a text: ``koord.Source("name.krd", "…")``.

    ``params`` are values of its params, by name: numbers (a float is the decimal that it is
    written as), Booleans, texts, names of members of enumerations, lists of these.
    ``properties`` are files, or texts, of further properties.

    Raises :class:`koord.KoordError` with everything that is wrong.

    >>> program = koord.load("task.krd", params={"tasks": 10})
    """
    report = check(text, params=params, properties=properties)
    if report.program is None:
        raise KoordError(report.errors or (no_program(report.source.name),))
    return report.program


def check(
    text: Text,
    *,
    params: Mapping[str, Value] | None = None,
    properties: Iterable[Text] = (),
    strict: bool = False,
) -> CheckReport:
    """Check a program, or a file of properties; return all diagnostics.

    The arguments are those of :func:`load`; with ``strict`` warnings are errors. Raises
    :class:`koord.KoordError` only where a file cannot be read.

    >>> koord.check("task.krd").errors
    ()
    """
    settings = Settings({name: exact(value) for name, value in (params or {}).items()})
    report = checked(source_of(text), settings, tuple(source_of(more) for more in properties))
    if not strict:
        return report
    errors = tuple(replace(d, severity=Severity.ERROR) for d in report.diagnostics)
    return replace(report, diagnostics=errors, program=None if errors else report.program)


def checked(source: Source, settings: Settings, properties: tuple[Source, ...]) -> CheckReport:
    """As :func:`check`, for texts."""
    found = texts.load(source, settings, properties)
    program = None
    if found.program is not None:
        program = Program(source, found.program, settings, properties, found.diagnostics)
    return CheckReport(source, properties, found.diagnostics, program)


def program_of(given: Loadable) -> Program:
    """A program, loaded if need be. Raises KoordError."""
    return given if isinstance(given, Program) else load(given)


def source_of(text: Text) -> Source:
    """A text, read if it is the name of a file. Raises KoordError."""
    if isinstance(text, Source):
        return Source(text.name, normalise(text.text))
    return read_program(os.fspath(text)).source


def exact(value: Value) -> ParamValue:
    """Convert a param's value to one of the semantics. Raises ArgumentError for invalid ones."""
    match value:
        case bool() | int() | str() | Fraction():
            return value
        case float():
            return exact_number("params", value)
        case Iterable():
            return tuple(exact(each) for each in value)
    raise ArgumentError("params", f"{value!r} is no value of a param")


def no_program(name: str) -> Diagnostic:
    """The diagnostic of a file without a program."""
    return Diagnostic(
        "K904",
        Severity.ERROR,
        whole_file(name),
        "there is no program in this file, only properties",
        "name a program, and this file behind `properties=`",
    )
