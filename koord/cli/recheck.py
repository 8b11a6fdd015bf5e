"""``koord recheck FILE``: settle the obligations of a certificate with another solver."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass

from koord.cli.arguments import add_json, check_files, seconds
from koord.cli.diagnostics import report_error
from koord.cli.exits import Exit
from koord.cli.files import DASH, STDIN_NAME, InputFile, read_bytes, read_program
from koord.cli.progress import LiveLine
from koord.cli.terminal import Paint, Style, style_of, visible
from koord.recheck.certificate import REWRITE, Certificate, read
from koord.recheck.checking import Outcome, Part, Rechecked, recheck
from koord.recheck.settling import Settled
from koord.recheck.solving import Answer, MissingSolverError, version
from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.source import NOWHERE

#: Raised when the JSON changes in a way that its readers must know of.
JSON_VERSION = 2

_SOLVERS = ("cvc5",)


@dataclass(frozen=True, slots=True)
class Request:
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
        "(no answer in time, a construct that is not rechecked, or the solver crashed)"
    )


def main(arguments: argparse.Namespace) -> int:
    given = arguments.program
    check_files([arguments.certificate, *([given] if given is not None else [])])
    return _recheck(
        Request(
            name=STDIN_NAME if arguments.certificate == DASH else arguments.certificate,
            raw=read_bytes(arguments.certificate),
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
        for text in _lines(certificate, found, solver, style_of(sys.stdout)):
            print(text)
    codes = {
        Outcome.CONFIRMED: Exit.OK,
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


def _lines(certificate: Certificate, found: Rechecked, solver: str, style: Style) -> list[str]:
    lines = [
        f"{visible(certificate.program.name)}: {_team(certificate)}, "
        f"delta {certificate.delta_s} s, {solver}",
        "claimed: " + visible(", ".join(claimed.name for claimed in certificate.claims)),
        "",
    ]
    if found.everyone is not None:
        lines += _part_lines(found.everyone, " for every number of robots")
    if found.here is not None:
        where = f" for {_team(certificate)}" if found.everyone is not None else ""
        lines += _part_lines(found.here, where)
    lines += [*_opinion_lines(found), ""]
    for names, scope in _confirmed(certificate, found):
        if names:
            lines += [f"{scope}, in every round: {visible(', '.join(names))}"]
    for name, reason in certificate.not_covered:
        lines += [f"not covered: {visible(name)}: {visible(reason)}"]
    paint = {
        Outcome.CONFIRMED: Paint.ADDED,
        Outcome.REFUTED: Paint.ERROR,
        Outcome.UNKNOWN: Paint.WARNING,
    }[found.outcome]
    verdict = style.paint(found.outcome.value, paint)
    why = f": {visible(found.reason)}" if found.reason else ""
    place = ""
    if found.span is not NOWHERE and found.reason:
        place = f" ({visible(found.span.file)}:{found.span.line}:{found.span.column})"
    return [*lines, f"{verdict}{why}{place} [{found.seconds:.1f} s]"]


def _team(certificate: Certificate) -> str:
    robots = len(certificate.kinds)
    return f"{robots} robot{'' if robots == 1 else 's'}"


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


def _confirmed(certificate: Certificate, found: Rechecked) -> list[tuple[list[str], str]]:
    """The names of the claims that are shown, for every number of robots and for those here."""
    everyone: list[str] = []
    here: list[str] = []
    if found.outcome is not Outcome.REFUTED:
        if found.everyone is not None and found.everyone.outcome is Outcome.CONFIRMED:
            everyone = [claimed.name for claimed in certificate.claims if claimed.everyone]
        if found.here is not None and found.here.outcome is Outcome.CONFIRMED:
            here = [claimed.name for claimed in certificate.claims if claimed.name not in everyone]
    return [(everyone, "for every number of robots"), (here, f"for {_team(certificate)}")]


_WORDS = {Answer.SAT: "does not follow", Answer.UNKNOWN: "not settled", Answer.UNSAT: "met"}


def _as_json(certificate: Certificate, found: Rechecked, solver: str) -> dict[str, object]:
    (everyone, _), (here, _) = _confirmed(certificate, found)
    place: dict[str, object] | None = None
    if found.span is not NOWHERE:
        span = found.span
        place = {"file": span.file, "line": span.line, "column": span.column}
    return {
        "version": JSON_VERSION,
        "verdict": found.outcome.value,
        "reason": found.reason,
        "place": place,
        "solver": solver,
        "program": certificate.program.name,
        "robots": len(certificate.kinds),
        "claims": [claimed.name for claimed in certificate.claims],
        "confirmed": {"every_number_of_robots": everyone, "these_robots": here},
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


_MET = {Answer.SAT: "not met", Answer.UNKNOWN: "unknown", Answer.UNSAT: "met"}


def _settled_json(one: Settled, *, every_number: bool) -> dict[str, object]:
    return {
        "name": one.name,
        "every_number": every_number,
        "answer": _MET[one.answer],
        "claim": one.claim,
        "configuration": list(one.state),
    }
