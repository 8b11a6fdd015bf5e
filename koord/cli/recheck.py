"""``koord recheck FILE``: settle the obligations of a certificate with another solver."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence

from msgspec import Struct

from koord.api.files import InputFile
from koord.cli.arguments import add_json, check_files, seconds
from koord.cli.diagnostics import report_error
from koord.cli.exits import Exit
from koord.cli.files import name_of, read_program, read_written
from koord.cli.progress import LiveLine
from koord.cli.terminal import Paint, Style, style_of, visible
from koord.recheck.certificate import REWRITE, Certificate, digest_of, read
from koord.recheck.checking import Outcome, Part, Rechecked, recheck
from koord.recheck.discharge import Settled
from koord.recheck.solving import Answer, MissingSolverError, version
from koord.recheck.statements import Premise, PremiseKind, Statement
from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.problem import told
from koord.syntax.source import NOWHERE, Span

#: Raised when the JSON changes in a way that its readers must know of.
JSON_VERSION = 3

_SOLVERS = ("cvc5",)


class Request(Struct, frozen=True):
    """Which certificate is to be rechecked, and how the answer is shown."""

    name: str
    raw: bytes
    program: InputFile | None  #: the program that it should be about
    timeout_s: float | None
    seed: int
    as_json: bool


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "certificate",
        metavar="FILE",
        help="a certificate that `koord verify --certificate` wrote; - is standard input",
    )
    parser.add_argument(
        "--program", metavar="FILE", help="refuse the certificate unless it is about this program"
    )
    parser.add_argument(
        "--solver", choices=_SOLVERS, default=_SOLVERS[0], help="which solver is asked (cvc5)"
    )
    parser.add_argument(
        "--timeout", metavar="SECONDS", type=seconds, help="give up after this time (never)"
    )
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of the solver (0)")
    add_json(parser, "the verdict")
    parser.epilog = (
        "exit codes: 0 confirmed, 1 refuted, 2 a damaged certificate or no solver, 3 unknown "
        "(no answer in time, a construct that is not rechecked, or the solver crashed), "
        "4 confirmed, but vacuously"
    )


def main(arguments: argparse.Namespace) -> int:
    given = arguments.program
    check_files([arguments.certificate, *([given] if given is not None else [])])
    return _recheck(
        Request(
            name=name_of(arguments.certificate),
            raw=read_written(arguments.certificate),
            program=read_program(given) if given is not None else None,
            timeout_s=arguments.timeout,
            seed=arguments.seed % 2**31,
            as_json=arguments.json,
        )
    )


def _recheck(request: Request) -> Exit:
    try:
        certificate = read(request.raw, request.name)
        if request.program is not None:
            _check_program(request, certificate, request.program)
        with LiveLine(sys.stderr) as line:
            found = recheck(certificate, request.timeout_s, request.seed, line.show)
        solver = version()
    except MissingSolverError:
        report_error(_no_solver(), as_json=request.as_json)
        return Exit.BAD_INPUT
    except KoordError as error:
        report_error(error, as_json=request.as_json)
        return Exit.BAD_INPUT
    if request.as_json:
        print(json.dumps(_as_json(certificate, found, solver), indent=2))
    else:
        for text in _lines(certificate, found, request, style_of(sys.stdout)):
            print(text)
    codes = {
        Outcome.CONFIRMED: Exit.VACUOUS if found.hollow else Exit.OK,
        Outcome.REFUTED: Exit.VIOLATED,
        Outcome.UNKNOWN: Exit.UNKNOWN,
    }
    return codes[found.outcome]


def _check_program(request: Request, certificate: Certificate, program: InputFile) -> None:
    if program.source.text != certificate.program.text:
        raise refusal(
            "K941",
            request.name,
            f"the certificate is about another text than {program.source.name}",
            REWRITE,
        )


def _no_solver() -> KoordError:
    message = "cvc5 is not installed, and a second opinion needs a second solver"
    hint = "install it with `pip install 'koord[recheck]'`, or `pip install cvc5`"
    return refusal("K942", "cvc5", message, hint)


def _lines(certificate: Certificate, found: Rechecked, request: Request, style: Style) -> list[str]:
    about = found.about
    digest = digest_of(certificate.program.text)
    of = "" if request.program is None else f", which is {request.program.source.name}"
    lines = [
        str(about.problem),
        f"  the text in the certificate{of}: SHA-256 {digest}",
        *(f"  param {told(given)}" for given in about.problem.program.parameters),
        "",
    ]
    if found.everyone is not None:
        lines += _part_lines(found.everyone, " for every number of robots")
    if found.here is not None:
        where = f" for {_team(found)}" if found.everyone is not None else ""
        lines += _part_lines(found.here, where)
    lines += [*_opinion_lines(found), ""]
    everyone, here = found.shown()
    rest = [s for s in about.statements if s not in (*everyone, *here)]
    lines += _said("shown for every number of robots, in every round:", everyone)
    lines += _said(f"shown for {_team(found)}, in every round:", here)
    lines += _said("claimed, and not shown:", rest)
    lines += _relied_on(about.premises)
    for name, reason in certificate.not_covered:
        lines += [f"not covered: {name}: {reason}"]
    lines += [f"vacuous: {why}" for why in found.hollow]
    paint = {
        Outcome.CONFIRMED: Paint.ADDED,
        Outcome.REFUTED: Paint.ERROR,
        Outcome.UNKNOWN: Paint.WARNING,
    }[found.outcome]
    verdict = style.paint(found.outcome.value, paint)
    if found.hollow and found.outcome is Outcome.CONFIRMED:
        verdict += ", but vacuously"
    why = f": {visible(found.reason)}" if found.reason else ""
    place = ""
    if found.span is not NOWHERE and found.reason:
        place = f" ({visible(str(found.span))})"
    last = f"{verdict}{why}{place}; {version()} [{found.seconds:.1f} s]"
    return [*map(visible, lines), last]


def _said(heading: str, statements: Sequence[Statement]) -> list[str]:
    """Statements in full: Koord, or what is asked of every program in words."""
    return [heading, *_indented(s.text for s in statements)] if statements else []


def _relied_on(premises: Sequence[Premise]) -> list[str]:
    """What is relied on: assumptions in full, of what is promised the names and places."""
    told = (
        p.text if p.kind is PremiseKind.ASSUMPTION else f"{p.kind.value} {p.name} ({p.span})"
        for p in premises
    )
    return ["relying on:", *_indented(told)] if premises else []


def _indented(texts: Iterable[str]) -> list[str]:
    return [f"  {line}" for text in texts for line in text.splitlines()]


def _team(found: Rechecked) -> str:
    return found.about.problem.fleet


def _part_lines(part: Part, where: str) -> list[str]:
    unmet = [one for one in part.settled if one.answer is not Answer.UNSAT]
    met = len(part.settled) - len(unmet)
    lines = [f"  {met} of {len(part.settled)} obligations{where} are met"]
    for one in unmet:
        lines += [f"  {_WORDS[one.answer]}: {visible(one.name)}: {visible(one.claim)}"]
        if one.answer is Answer.SAT:
            lines += ["    from a configuration in which the invariant holds, such as"]
            lines += [f"      {visible(text)}" for text in one.state]
    return lines


def _opinion_lines(found: Rechecked) -> list[str]:
    other = [opinion for opinion in found.opinions if opinion.answer is not Answer.UNSAT]
    same, of = len(found.opinions) - len(other), len(found.opinions)
    lines = [f"  {same} of {of} scripts in the certificate are agreed with"]
    for opinion in other:
        sat = opinion.answer is Answer.SAT
        what = "it can be satisfied" if sat else f"not settled: {opinion.reason}"
        lines += [f"  {visible(opinion.name)}: {visible(what)}"]
    return lines


_WORDS = {Answer.SAT: "does not follow", Answer.UNKNOWN: "not settled", Answer.UNSAT: "met"}


def _as_json(certificate: Certificate, found: Rechecked, solver: str) -> dict[str, object]:
    everyone, here = found.shown()
    return {
        "version": JSON_VERSION,
        "verdict": found.outcome.value,
        "reason": found.reason,
        "place": _place(found.span),
        "solver": solver,
        "program": certificate.program.name,
        "sha256": digest_of(certificate.program.text),
        "problem": found.about.problem.document(),
        "vacuous": list(found.hollow),
        "claims": [
            {
                "kind": s.claimed.kind.value,
                "subject": s.claimed.subject,
                "name": s.claimed.name,
                "statement": s.text,
                "place": _place(s.span),
                "shown_for": "every number of robots"
                if s in everyone
                else "these robots"
                if s in here
                else None,
            }
            for s in found.about.statements
        ],
        "relies_on": [
            {"kind": p.kind.value, "name": p.name, "statement": p.text, "place": _place(p.span)}
            for p in found.about.premises
        ],
        "not_covered": [
            {"name": name, "reason": reason} for name, reason in certificate.not_covered
        ],
        "obligations": [
            _settled_json(one, every_number=part is found.everyone)
            for part in (found.everyone, found.here)
            if part is not None
            for one in part.settled
        ],
        "scripts": [
            {
                "name": opinion.name,
                "answer": _MET[opinion.answer],
                "reason": opinion.reason,
            }
            for opinion in found.opinions
        ],
        "seconds": round(found.seconds, 3),
    }


def _place(span: Span) -> dict[str, object] | None:
    """A place in the text; None for what stands in none."""
    if span.file == NOWHERE.file:
        return None
    return {"file": span.file, "line": span.line, "column": span.column}


_MET = {Answer.SAT: "not met", Answer.UNKNOWN: "unknown", Answer.UNSAT: "met"}


def _settled_json(one: Settled, *, every_number: bool) -> dict[str, object]:
    return {
        "name": one.name,
        "every_number": every_number,
        "answer": _MET[one.answer],
        "claim": one.claim,
        "configuration": list(one.state),
    }
