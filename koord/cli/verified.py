"""Output of ``koord verify``: verdicts on the terminal, and the files that were asked for."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from koord.api.files import write_atomically
from koord.api.programs import Program
from koord.api.verify import Options
from koord.cli.diagnostics import complain
from koord.cli.exits import Exit, gravest
from koord.cli.terminal import is_debugging, style_of

if TYPE_CHECKING:
    from koord.api.verdict_forms import Report
    from koord.api.verdicts import Parts
    from koord.api.verify_report import VerifyReport


def tell(report: VerifyReport, arguments: argparse.Namespace, told: list[Report]) -> Exit:
    """Show and keep the verdicts on one system; with --json add them to ``told``."""
    # What verdicts are made of loads Z3, and the other commands start without it.
    from koord.api.verdicts import Parts

    for failure in report.failed:
        complain(failure)
    if report.asks_nothing_between:
        _note("no invariant reads a sensor, so none can break between rounds")
    parts = Parts(complain)
    if arguments.json:
        told.append(report.form(parts))
    else:
        _show(report, arguments, parts)
    if arguments.trace is not None:
        with parts.enduring("the trace"):
            _keep(report, arguments.trace)
    if arguments.found is not None:
        with parts.enduring("the file of invariants"):
            _save(report, arguments.found)
    if arguments.certificate is not None and not report.interrupted:
        with parts.enduring("the certificate"):
            _certify(report, arguments.certificate)
    failures = (*report.failures, *parts.failures)
    if arguments.json:
        from koord.api.verdict_documents import failure_forms

        told[-1].failures = failure_forms(failures)
    if is_debugging():
        for failure in failures:
            print(failure.trace, file=sys.stderr)
    return _exit(report)


def _show(report: VerifyReport, arguments: argparse.Namespace, parts: Parts) -> None:
    """Print the verdicts as text, with the runs that break claims."""
    from koord.cli import verdicts

    style = style_of(sys.stdout)
    for text in verdicts.lines(report, style):
        print(text)
    for verdict in report.verdicts:
        if verdict.found.counterexample is not None:
            from koord.cli import counterexamples

            print()
            with parts.enduring(f"the story of {verdict.name}"):
                for text in counterexamples.lines(verdict, style):
                    print(text)
        elif arguments.explain and verdict.found.step is not None:
            from koord.cli.counterexamples import step_lines

            print()
            with parts.enduring(f"the step of {verdict.name}"):
                for text in step_lines(verdict, style):
                    print(text)
    if arguments.explain:
        from koord.cli.verdicts import cone_lines

        with parts.enduring("what claims do not depend on"):
            independent = list(cone_lines(report.cones))
            if independent:
                print("\n" + "\n".join(independent))
    if report.rests_on is not None:
        from koord.cli.verdicts import core_lines

        print()
        with parts.enduring("what the proofs rest on"):
            for text in core_lines(report.program, report.rests_on, style):
                print(text)
    if report.execution_times is not None:
        from koord.cli.execution_times import lines

        print()
        file, delta_s = report.program.source.name, float(report.system.delta_s)
        for text in lines(report.execution_times, file, delta_s, style):
            print(text)
    print()
    print(verdicts.summary(report, style))


def tell_sweep(
    program: Program,
    reports: Iterable[VerifyReport],
    arguments: argparse.Namespace,
    told: list[Report],
) -> Exit:
    """Report one number of robots after the other; Ctrl-C ends it with those that are done."""
    from koord.api import pictures
    from koord.api.verdicts import Parts
    from koord.cli import verdicts

    style = style_of(sys.stdout)
    of_all = program.problem(None, arguments.delta)
    points: list[VerifyReport] = []
    if not arguments.json:
        print("\n".join(verdicts.heading(of_all, style)))
    for report in reports:
        points.append(report)
        parts = Parts(complain)
        told.append(report.form(parts))
        if not arguments.json:
            print(verdicts.row(report, style), flush=True)
        if report.interrupted:
            break
    if arguments.plot is not None and points:
        with Parts(complain).enduring("the plot"):
            pictures.draw_sweep(arguments.plot, of_all, points)
    if len(points) < len(arguments.robots):
        return Exit.INTERRUPTED
    return gravest(_exit(point) for point in points)


def _exit(report: VerifyReport) -> Exit:
    from koord.verify.verdicts import Outcome

    if report.interrupted:
        return Exit.INTERRUPTED
    codes = {
        Outcome.HOLDS: Exit.VACUOUS if report.is_vacuous else Exit.OK,
        Outcome.VIOLATED: Exit.VIOLATED,
        Outcome.UNKNOWN: Exit.UNKNOWN,
    }
    return codes[report.outcome]


def _keep(report: VerifyReport, path: str) -> None:
    """Write the trace of the shortest violation; report if there is none."""
    from koord.api.traces import write_counterexample

    shortest = report.counterexample
    if shortest is None:
        _note("no claim is violated, so there is no trace to write")
    else:
        write_counterexample(path, shortest.recorded)


def show_page(reports: Sequence[VerifyReport], path: str) -> None:
    """Write the page of some verifications."""
    from koord.api.html import verification_page
    from koord.api.verdicts import Parts

    parts = Parts(complain)
    with parts.enduring("the page"):
        write_atomically(path, verification_page(reports, parts).encode("utf-8"))
    if is_debugging():
        for failure in parts.failures:
            print(failure.trace, file=sys.stderr)


def _save(report: VerifyReport, path: str) -> None:
    """Write the inferred invariants; report if there are none."""
    if report.invariants:
        write_atomically(path, report.invariants.encode("utf-8"))
    else:
        _note("no invariant was found that a proof rests on")


def _certify(report: VerifyReport, path: str) -> None:
    """Write the certificate of the claims that hold in all rounds; report what is not in it."""
    from koord.api.certify import certify

    made = certify(report, timeout_s=Options(ends_at=report.ends_at).left_s)
    if made is None:
        _note("no claim is shown by induction in all rounds, so there is nothing to certify")
        return
    made.save(path)
    for name, reason in made.not_covered.items():
        _note(f"not in the certificate: {name}: {reason}")


def _note(text: str) -> None:
    print(f"koord verify: {text}", file=sys.stderr)
