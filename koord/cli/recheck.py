"""``koord recheck FILE``: settle the obligations of a certificate with another solver."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence

from koord.api.recheck import RecheckReport, read_about, rechecked
from koord.cli.arguments import add_json, check_files, seconds
from koord.cli.exits import Exit
from koord.cli.files import name_of, read_program, read_written
from koord.cli.progress import LiveLine
from koord.cli.terminal import Paint, Style, style_of, visible
from koord.recheck.checking import CheckedPart, Rechecked, RecheckOutcome
from koord.recheck.claims import ClaimKind
from koord.recheck.meaning import Statement
from koord.recheck.premises import Premise, PremiseKind
from koord.recheck.solving import SolverAnswer
from koord.syntax.problem import told
from koord.syntax.source import NOWHERE, Source

_SOLVERS = ("cvc5",)


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
    name, raw = name_of(arguments.certificate), read_written(arguments.certificate)
    program = None if given is None else read_program(given).source
    certificate = read_about(raw, name, program)
    with LiveLine(sys.stderr) as line:
        seed = arguments.seed % 2**31
        report = rechecked(certificate, arguments.timeout, seed, line.show)
    if arguments.json:
        print(report.to_json())
    else:
        for text in _lines(report, program, style_of(sys.stdout)):
            print(text)
    codes = {
        RecheckOutcome.CONFIRMED: Exit.VACUOUS if report.vacuous else Exit.OK,
        RecheckOutcome.REFUTED: Exit.VIOLATED,
        RecheckOutcome.UNKNOWN: Exit.UNKNOWN,
    }
    return codes[report.outcome]


def _lines(report: RecheckReport, program: Source | None, style: Style) -> list[str]:
    certificate, found, about = report.certificate, report.found, report.found.about
    digest = report.sha256
    of = "" if program is None else f", which is {program.name}"
    lines = [
        str(about.problem),
        f"  the text in the certificate{of}: SHA-256 {digest}",
        *(f"  param {told(given)}" for given in about.problem.program.parameters),
        "",
    ]
    if found.everyone is not None:
        lines += _part_lines(found.everyone, " for every number of robots")
    if found.runs is not None:
        lines += _part_lines(found.runs, " about whole runs of every number of robots")
    if found.here is not None:
        where = f" for {_team(found)}" if found.everyone is not None else ""
        lines += _part_lines(found.here, where)
    lines += [*_opinion_lines(found), ""]
    everyone, here = found.shown()
    rest = [s for s in about.statements if s not in (*everyone, *here)]
    of_runs = tuple(s for s in everyone if s.claimed.kind is ClaimKind.LIVENESS)
    in_rounds = tuple(s for s in everyone if s not in of_runs)
    lines += _said("shown for every number of robots, in every round:", in_rounds)
    lines += _said("shown for every number of robots, of every fair run:", of_runs)
    lines += _said(f"shown for {_team(found)}, in every round:", here)
    lines += _said("claimed, and not shown:", rest)
    lines += _relied_on(about.premises)
    for name, reason in certificate.not_covered:
        lines += [f"not covered: {name}: {reason}"]
    lines += [f"vacuous: {why}" for why in found.hollow]
    paint = {
        RecheckOutcome.CONFIRMED: Paint.ADDED,
        RecheckOutcome.REFUTED: Paint.ERROR,
        RecheckOutcome.UNKNOWN: Paint.WARNING,
    }[found.outcome]
    verdict = style.paint(found.outcome.value, paint)
    if found.hollow and found.outcome is RecheckOutcome.CONFIRMED:
        verdict += ", but vacuously"
    why = f": {visible(found.reason)}" if found.reason else ""
    place = ""
    if found.span is not NOWHERE and found.reason:
        place = f" ({visible(str(found.span))})"
    last = f"{verdict}{why}{place}; {report.solver} [{found.seconds:.1f} s]"
    return [*map(visible, lines), last]


def _said(heading: str, statements: Sequence[Statement]) -> list[str]:
    """Print statements in full: Koord, or words for claims about every program."""
    return [heading, *_indented(s.text for s in statements)] if statements else []


_IN_FULL = (PremiseKind.ASSUMPTION, PremiseKind.FAIRNESS)


def _relied_on(premises: Sequence[Premise]) -> list[str]:
    """Print premises: assumptions in full, of others the names and places."""
    told = (
        p.text if p.kind in _IN_FULL else f"{p.kind.value} {p.name} ({p.span})" for p in premises
    )
    return ["relying on:", *_indented(told)] if premises else []


def _indented(texts: Iterable[str]) -> list[str]:
    return [f"  {line}" for text in texts for line in text.splitlines()]


def _team(found: Rechecked) -> str:
    return found.about.problem.fleet


def _part_lines(part: CheckedPart, where: str) -> list[str]:
    unmet = [one for one in part.settled if one.answer is not SolverAnswer.UNSAT]
    met = len(part.settled) - len(unmet)
    lines = [f"  {met} of {len(part.settled)} obligations{where} are met"]
    for one in unmet:
        lines += [f"  {_WORDS[one.answer]}: {visible(one.name)}: {visible(one.claim)}"]
        if one.answer is SolverAnswer.SAT:
            lines += ["    from a configuration in which the invariant holds, such as"]
            lines += [f"      {visible(text)}" for text in one.state]
    return lines


def _opinion_lines(found: Rechecked) -> list[str]:
    other = [opinion for opinion in found.opinions if opinion.answer is not SolverAnswer.UNSAT]
    same, of = len(found.opinions) - len(other), len(found.opinions)
    lines = [f"  {same} of {of} scripts in the certificate are agreed with"]
    for opinion in other:
        sat = opinion.answer is SolverAnswer.SAT
        what = "it can be satisfied" if sat else f"not settled: {opinion.reason}"
        lines += [f"  {visible(opinion.name)}: {visible(what)}"]
    return lines


_WORDS = {
    SolverAnswer.SAT: "does not follow",
    SolverAnswer.UNKNOWN: "not settled",
    SolverAnswer.UNSAT: "met",
}
