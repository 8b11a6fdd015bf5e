"""Programs as files of tests: a claim is an item, and a file is verified once."""

from __future__ import annotations

import argparse
import os
import shlex
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from koord.api.cache import Cache, usual_folder
from koord.api.claims import claim_places
from koord.api.files import input_file, read_bytes
from koord.api.program_files import SAID
from koord.api.programs import Program, check, load
from koord.api.results import ArgumentError
from koord.api.robots import system_of
from koord.api.verify import Options, Question, verify, verify_each
from koord.api.verify_report import VerifyReport
from koord.cli.arguments import add_settings, settings
from koord.cli.diagnostics import render
from koord.cli.verify import add_question, options_of
from koord.plugins.choices import CHOICES
from koord.plugins.flags import FlagError, Flags
from koord.syntax.diagnostics import Diagnostic, KoordError
from koord.syntax.source import Source, Span, is_whole_file

#: The item that says whether the verdicts of a program say what they seem to.
VACUITY = "not vacuous"


class KoordWarning(pytest.PytestWarning):
    """What koord warns of in a program, or a verdict that is unknown or vacuous."""


class ClaimError(Exception):
    """Raised for a claim that does not hold; the text is what pytest shows."""


def _flags() -> Flags:
    """The parser of flags of ``koord verify`` that make sense in tests."""
    parser = Flags("koord verify", "")
    add_question(parser)
    add_settings(parser)
    parser.add_argument("--cache", action="store_true")
    return parser


class ProgramFile(pytest.File):
    """A program: an item for each claim, of each number of robots."""

    is_named: bool
    questions: list[Question]
    options: Options
    reports: dict[int, VerifyReport]  #: by the position of the question

    @classmethod
    def made(cls, parent: pytest.Collector, path: Path, *, is_named: bool) -> ProgramFile:
        """A file to collect; ``is_named``: somebody has asked for this very file."""
        made: ProgramFile = cls.from_parent(parent, path=path)
        made.is_named = is_named
        made.questions = []
        made.reports = {}
        return made

    def collect(self) -> Iterator[pytest.Item]:
        try:
            source = self._read(self.path)
            arguments = self._arguments(source)
            properties = tuple(self._read(self.path.parent / x) for x in arguments.properties)
            found = check(source, params=settings(arguments.settings), properties=properties)
            self._tell(found.diagnostics, (source, *properties))
            if found.program is None:
                if self.is_named:
                    raise self.CollectError(f"{source.name}: there is no program in this file")
                return
            yield from self._items(found.program, arguments)
        except (FlagError, argparse.ArgumentTypeError) as error:
            raise self.CollectError(f"{self.name}: flags of koord verify: {error}") from None
        except ArgumentError as error:
            raise self.CollectError(f"{self.name}: {error.message}") from None
        except KoordError as error:
            raise self.CollectError("\n".join(_shown(error.diagnostics, ()))) from None

    def _read(self, path: Path) -> Source:
        """A text, by its name from where pytest was started. Raises KoordError."""
        name = os.path.relpath(path, self.config.invocation_params.dir)
        return input_file(str(path), name, read_bytes(str(path))).source

    def _arguments(self, source: Source) -> argparse.Namespace:
        """How the program is to be verified: by the project, by its text, by the command line."""
        said = [
            str(self.config.getini("koord_verify")),
            *SAID.findall(source.text),
            str(self.config.getoption("koord_verify")),
        ]
        try:
            words = [word for text in said for word in shlex.split(text)]
        except ValueError as error:  # a quote that is not closed
            raise FlagError(str(error)) from None
        return _flags().parse_args(words)

    def _tell(self, diagnostics: tuple[Diagnostic, ...], sources: Iterable[Source]) -> None:
        """Raise CollectError for errors; warn of the rest."""
        if any(one.severity.value == "error" for one in diagnostics):
            raise self.CollectError("\n".join(_shown(diagnostics, sources)))
        for one in diagnostics:
            try:
                self.warn(KoordWarning(f"{one.span}: {one.code}: {one.message}"))
            except KoordWarning as warning:  # of which the project makes errors
                raise self.CollectError(str(warning)) from None

    def _items(self, program: Program, arguments: argparse.Namespace) -> Iterator[pytest.Item]:
        cache = Cache(usual_folder()) if arguments.cache else None
        self.options = options_of(arguments, cache)
        for number, fleet in enumerate(arguments.robots):
            system = system_of(program.core, fleet, arguments.delta)
            self.questions.append(Question(program, system, every_n=fleet.any_number))
            which = "" if len(arguments.robots) == 1 else f"[{system.robots} robots]"
            places = claim_places(system)
            unknown = [name for name in arguments.names if name not in places]
            if unknown:
                known = ", ".join(places)
                raise self.CollectError(f"there is no property {unknown[0]!r}; there are {known}")
            for name, place in places.items():
                if not arguments.names or name in arguments.names:
                    yield ClaimItem.made(self, f"{name}{which}", (number, name), place)
            yield VacuityItem.made(self, f"{VACUITY}{which}", (number, VACUITY), None)

    def report(self, number: int) -> VerifyReport:
        """The verdicts on the claims whose items are to run; they are found once."""
        if number not in self.reports:
            items = [one for one in self.session.items if isinstance(one, ClaimItem)]
            mine = [one for one in items if one.parent is self and one.question == number]
            names = tuple(one.claim for one in mine if not isinstance(one, VacuityItem))
            question = self.questions[number]
            every = set(names) == set(claim_places(question.system))
            options = replace_names(self.options, () if every else names)
            (self.reports[number],) = verify_each(
                [question], options, lambda text: None, lambda: False
            )
        return self.reports[number]


class ClaimItem(pytest.Item):
    """A claim about a program with some number of robots."""

    question: int
    claim: str
    place: Span | None

    @classmethod
    def made(
        cls, parent: ProgramFile, name: str, of: tuple[int, str], place: Span | None
    ) -> ClaimItem:
        made: ClaimItem = cls.from_parent(parent, name=name)
        (made.question, made.claim), made.place = of, place
        return made

    @property
    def found(self) -> VerifyReport:
        """The verdicts, which are found when the first item of a file runs."""
        assert isinstance(self.parent, ProgramFile)
        return self.parent.report(self.question)

    def runtest(self) -> None:
        verdict = self.found.verdict(self.claim)
        self.user_properties.append(("verdict", repr(verdict)))
        self.add_report_section("call", "verdict", repr(verdict))
        judge(self.found, [self.claim], self.config, None)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        if isinstance(excinfo.value, ClaimError):
            return str(excinfo.value)
        if isinstance(excinfo.value, KoordError):  # of the program, met on the way
            return "\n".join(_shown(excinfo.value.diagnostics, ()))
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        has_line = self.place is not None and not is_whole_file(self.place)
        line = self.place.line - 1 if self.place is not None and has_line else None
        return self.path, line, self.name


class VacuityItem(ClaimItem):
    """Whether verdicts say what they seem to, if nothing is broken."""

    def runtest(self) -> None:
        judge_vacuities(self.found, self.config, None)


def judge(
    report: VerifyReport, names: Iterable[str], config: pytest.Config, unknown: str | None
) -> None:
    """Raise ClaimError for claims that do not hold, with the runs that break them."""
    from koord.cli.counterexamples import lines
    from koord.cli.terminal import PLAIN

    broken, open_ = [], []
    for verdict in (report.verdict(name) for name in names):
        if verdict.found.counterexample is not None:
            broken += ["", *lines(verdict, PLAIN)]
        elif not verdict.holds:
            open_ += [f"{verdict.name} is unknown: {verdict.reason}", *verdict.obstacles]
            open_ += [str(failure) for failure in report.failures]
    if broken:
        raise ClaimError("\n".join([str(report.problem), *broken, *open_]))
    if open_:
        _become(chosen("unknown", unknown, config), [str(report.problem), *open_])


def judge_vacuities(report: VerifyReport, config: pytest.Config, vacuous: str | None) -> None:
    """Raise ClaimError, or warn, where verdicts say less than they seem to."""
    if not report.is_vacuous:
        return
    said = [one.told for one in report.vacuities]
    heading = f"{report.problem}: verdicts say less than they seem to"
    _become(chosen("vacuous", vacuous, config), [heading, *said])


def chosen(what: str, given: str | None, config: pytest.Config) -> str:
    """What becomes of unknown or vacuous verdicts: by the call, the command line, the project."""
    choice = given or config.getoption(f"koord_{what}") or config.getini(f"koord_{what}")
    if choice not in CHOICES:
        known = ", ".join(CHOICES)
        pytest.fail(f"{what}={choice!r} has to be one of {known}", pytrace=False)
    return str(choice)


def _become(choice: str, said: list[str]) -> None:
    text = "\n".join(said)
    if choice == "fail":
        raise ClaimError(text)
    if choice == "xfail":
        pytest.xfail(text)
    import warnings

    warnings.warn(KoordWarning(text), stacklevel=2)


def replace_names(options: Options, names: tuple[str, ...]) -> Options:
    """Options that ask for claims by name."""
    from msgspec.structs import replace

    return replace(options, properties=names)


def _shown(diagnostics: tuple[Diagnostic, ...], sources: Iterable[Source]) -> Iterator[str]:
    """Diagnostics as the command line shows them."""
    by_name = {source.name: source for source in sources}
    for one in diagnostics:
        yield from render(one, by_name)


def verifier(request: pytest.FixtureRequest) -> Callable[..., VerifyReport]:
    """What the fixture ``koord_verify`` is."""

    def koord_verify(
        program: Program | str | os.PathLike[str],
        *,
        unknown: str | None = None,
        vacuous: str | None = None,
        **arguments: Any,
    ) -> VerifyReport:
        """Verify a program; fail where a claim does not hold."""
        if not isinstance(program, Program):
            try:
                program = load(request.path.parent / os.fspath(program))
            except KoordError as error:
                pytest.fail("\n".join(_shown(error.diagnostics, ())), pytrace=False)
        report = verify(program, **arguments)
        try:
            judge(report, [one.name for one in report.verdicts], request.config, unknown)
            judge_vacuities(report, request.config, vacuous)
        except ClaimError as error:
            pytest.fail(str(error), pytrace=False)
        return report

    return koord_verify
