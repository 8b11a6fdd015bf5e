"""The playground's worker asks koord by this: a request comes in, an answer goes out, as JSON.

It is all of Python that the page itself has. There are neither processes nor threads in a browser,
so one job does everything, and who cancels ends the worker.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Literal, TypeAlias

import msgspec
from msgspec import Struct

import koord
from koord.api.robots import Robots
from koord.syntax.literals import ParamValue, read_value

#: What hears of progress: a line of text, and the verdicts so far as JSON, where there are any.
Teller: TypeAlias = Callable[[str, str], None]

#: What a program is called in messages.
NAME = "program.krd"

#: One value of a param, and what is behind it.
_PARAM = re.compile(r"([A-Za-z_]\w*)\s*=\s*(\[[^\]]*\]|[^,\[\]]+)(?:,\s*|$)")

#: More would fill the page, and the memory that it has.
MOST_ROUNDS = 1000


class Request(Struct, frozen=True, forbid_unknown_fields=True):
    """What is to be done with a text; ``robots`` is a number, ``any``, ``Car=2, Drone=1`` or empty.

    Without a number of robots it is that which the program states. ``params`` are values of its
    params: ``tasks=4, spots=[1, 2]``. ``policy`` and ``seed`` are those of runs.
    """

    do: Literal["check", "verify", "run"]
    text: str
    robots: str = ""
    rounds: int = 20
    policy: Literal["first", "random"] = "first"
    seed: int = 0
    params: str = ""


class Problem(Struct, frozen=True):
    """A diagnostic; lines and columns count from 1, and the end is behind the last character.

    ``line`` is 0 where it is about the text as a whole, or about what was asked.
    """

    severity: str
    code: str
    message: str
    hint: str
    line: int
    column: int
    end_line: int
    end_column: int


class Mark(Struct, frozen=True):
    """A verdict at the line of its claim; ``kind`` is a word of ``koord.api.verdict_marks``."""

    name: str
    kind: str
    line: int
    title: str
    story: str


class Answer(Struct, frozen=True):
    """What came of a request: a line that says so, problems, marks, and a page that shows it all.

    ``outcome`` is ``done`` where nothing is wrong, ``holds``, ``violated`` or ``unknown`` of a
    verification, and ``refused`` where there is no program to look at.
    """

    outcome: str
    summary: str
    problems: list[Problem]
    marks: list[Mark] = []
    page: str = ""


def answer(request: str, tell: Teller) -> str:
    """Do what a request asks; ``tell`` hears of progress. The answer is JSON of :class:`Answer`."""
    asked = msgspec.json.decode(request, type=Request)
    return msgspec.json.encode(answered(asked, tell)).decode()


def answered(asked: Request, tell: Teller) -> Answer:
    """Do what is asked. What is wrong with a program, or with what is asked of it, is an answer."""
    tell("reading the program", "")
    try:
        report = koord.check(koord.Source(NAME, asked.text), params=params_of(asked.params))
    except koord.ArgumentError as error:
        problems = [_whole(f"{error.argument}: {error.message}")]
        return Answer("refused", problems[-1].message, problems)
    problems = [_problem(one) for one in report.diagnostics]
    if report.program is None or asked.do == "check":
        errors, warnings = len(report.errors), len(report.warnings)
        summary = _counted(errors, warnings)
        if report.program is None and not errors:
            problems.append(_whole("there is no program in this text, only properties"))
            summary = _counted(1, warnings)
        return Answer("refused" if report.program is None else "done", summary, problems)
    try:
        robots = robots_of(asked.robots)
        if not 1 <= asked.rounds <= MOST_ROUNDS:
            raise koord.ArgumentError("rounds", f"a number from 1 to {MOST_ROUNDS}")
        if asked.do == "verify":
            return _verified(report.program, asked, robots, problems, tell)
        return _ran(report.program, asked, robots, problems, tell)
    except koord.ArgumentError as error:
        problems.append(_whole(f"{error.argument}: {error.message}"))
    except koord.KoordError as error:
        problems += [_problem(one) for one in error.diagnostics]
    except MemoryError:
        problems.append(_whole("the browser has not enough memory for so many robots or rounds"))
    return Answer("refused", problems[-1].message, problems)


def load_engines() -> None:
    """Load all that a verification is made of, before somebody asks for one."""
    answered(Request("verify", _SMALL, "2"), lambda text, marks: None)
    answered(Request("run", _SMALL, "2", rounds=1), lambda text, marks: None)


#: A program that is verified in no time, by more than one engine.
_SMALL = """local:
    int x = 0

Go:
    pre: x < 2
    eff: x = x + 1

invariant Few: forall i: x@i <= 2
invariant Wrong: forall i: x@i <= 1
"""


def robots_of(text: str) -> Robots:
    """Read a number of robots. Raises ArgumentError where it is none."""
    text = text.strip()
    if not text:
        return None
    if text == "any":
        return "any"
    if text.isdecimal():
        return int(text)
    kinds = re.findall(r"(\w+)\s*=\s*(\d+)\s*(?:,|$)", text)
    if not kinds or re.sub(r"(\w+)\s*=\s*(\d+)\s*(?:,|$)\s*", "", text):
        raise koord.ArgumentError("robots", f"{text!r} is no number: 3, or any, or Car=2, Drone=1")
    return {name: int(number) for name, number in kinds}


def params_of(text: str) -> dict[str, ParamValue]:
    """Read values of params. Raises ArgumentError where they are none."""
    found: dict[str, ParamValue] = {}
    rest = text.strip().rstrip(",")
    while rest:
        match = _PARAM.match(rest)
        try:
            if match is None:
                raise ValueError
            found[match[1]] = read_value(match[2])
        except ValueError:
            story = f"{rest!r} are no values: tasks=4, spots=[1, 2]"
            raise koord.ArgumentError("params", story) from None
        rest = rest[match.end() :]
    return found


def _marks(report: koord.VerifyReport, document: koord.Document) -> list[Mark]:
    """The verdicts of a report, each at its line."""
    from koord.api.verdict_marks import verdict_marks

    return [
        Mark(mark.name, mark.kind.value, mark.span.line, mark.title, mark.story)
        for mark in verdict_marks(report, document)
    ]


def _verified(
    program: koord.Program,
    asked: Request,
    robots: Robots,
    problems: list[Problem],
    tell: Teller,
) -> Answer:
    document, known = koord.document(program.source, params=program.settings.params), ""

    def hear(heard: koord.Progress) -> None:
        nonlocal known
        if isinstance(heard, koord.VerdictProgress):
            known = msgspec.json.encode(_marks(heard.report, document)).decode()
        tell(heard.message, known)

    report = koord.verify(program, robots=robots, rounds=asked.rounds, jobs=1, progress=hear)
    tell("drawing what was found", known)
    marks, outcome = _marks(report, document), report.outcome.value
    broken = [mark.name for mark in marks if mark.kind in ("violated", "unknown")]
    summary = f"{outcome}: {', '.join(broken)}" if broken else f"{outcome}, every claim"
    return Answer(outcome, summary, problems, marks, koord.html(report))


def _ran(
    program: koord.Program,
    asked: Request,
    robots: Robots,
    problems: list[Problem],
    tell: Teller,
) -> Answer:
    report = koord.run(
        program,
        robots=robots,
        rounds=asked.rounds,
        policy=asked.policy,
        seed=asked.seed,
        progress=lambda heard: tell(heard.message, ""),
    )
    tell("drawing the run", "")
    story = koord.story(report)
    outcome = "violated" if report.ending.broken else "done"
    return Answer(outcome, story.headline, problems, [], story.to_html())


def _problem(found: koord.Diagnostic) -> Problem:
    span = found.span
    return Problem(
        found.severity.value,
        found.code,
        found.message,
        found.hint or "",
        span.line if span.file == NAME else 0,
        span.column,
        span.end_line,
        span.end_column,
    )


def _whole(message: str) -> Problem:
    """A problem of what was asked, which has no place in the text."""
    return Problem("error", "", message, "", 0, 0, 0, 0)


def _counted(errors: int, warnings: int) -> str:
    if not errors and not warnings:
        return "no mistakes found"
    words = []
    for number, word in ((errors, "error"), (warnings, "warning")):
        if number:
            words.append(f"{number} {word}{'' if number == 1 else 's'}")
    return ", ".join(words)
