"""What was found out is shown, and kept in the files that were asked for."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from msgspec import Struct, field

from koord.api.files import write_atomically
from koord.api.programs import Program
from koord.cli.asking import Asked, resting
from koord.cli.exits import Exit, gravest
from koord.cli.requests import Request
from koord.cli.terminal import is_debugging, style_of
from koord.syntax.diagnostics import KoordError
from koord.syntax.problem import Problem

if TYPE_CHECKING:
    from koord.refinement.compiled_replay import Rerun
    from koord.verify.failures import Failure
    from koord.verify.verdicts import Counterexample, Verdict
    from koord.verify.verdicts import Report as Verification


class _Parts(Struct):
    """What is told beside verdicts: a part that fails is named, and costs nothing else."""

    failures: list[Failure] = field(default_factory=list)
    _in_json: int = 0  #: so many of them are in a document

    @contextmanager
    def enduring(self, part: str) -> Iterator[None]:
        try:
            yield
        except (KoordError, OSError, MemoryError):
            raise
        except Exception as error:
            from koord.verify.failures import failure_of

            failure = failure_of(part, error)
            self.failures.append(failure)
            print(
                f"koord verify: {failure}; a mistake in koord, the verdicts stand", file=sys.stderr
            )

    def add_to(self, document: dict[str, object]) -> None:
        """Put what failed since the last document into this one."""
        from koord.cli.verdicts import failed

        before = document["failures"]
        assert isinstance(before, list)
        before += [failed(each) for each in self.failures[self._in_json :]]
        self._in_json = len(self.failures)


def tell(program: Program, asked: Asked, request: Request, told: list[dict[str, object]]) -> Exit:
    """Show the verdicts on one system, and keep what is to be kept; with --json add to ``told``."""
    # What shows verdicts loads Z3, and the other commands start without it.
    from koord.cli import verdicts

    system, bounds, report = asked.system, asked.bounds, asked.report
    if asked.asks_nothing_between:
        why = "no invariant reads a sensor, so none can break between rounds"
        print(f"koord verify: {why}", file=sys.stderr)
    parts = _Parts()
    found = None
    if request.rests_on:
        with parts.enduring("what the proofs rest on"):
            found = resting(system, bounds, asked.at_ends, request)
    if request.as_json:
        document = _as_json(program, asked, request, parts)
        if found is not None:
            with parts.enduring("what the proofs rest on"):
                from koord.cli import premises

                document["rests_on"] = premises.as_json(found)
        told.append(document)
    else:
        style = style_of(sys.stdout)
        for text in verdicts.lines(_problem(program, asked), report, style):
            print(text)
        for verdict in report.verdicts:
            if verdict.counterexample is not None:
                from koord.cli import counterexamples

                print()
                with parts.enduring(f"the story of {verdict.claim.name}"):
                    for text in counterexamples.lines(
                        program, asked.system_of(verdict), verdict, style, request.left_s()
                    ):
                        print(text)
            elif request.explain and verdict.step is not None:
                from koord.cli import steps

                print()
                with parts.enduring(f"the step of {verdict.claim.name}"):
                    for text in steps.lines(system, verdict, style):
                        print(text)
        if request.explain:
            from koord.cli import slices

            with parts.enduring("what claims do not depend on"):
                independent = list(slices.lines(system, report))
                if independent:
                    print("\n" + "\n".join(independent))
        if found is not None:
            from koord.cli import premises

            print()
            with parts.enduring("what the proofs rest on"):
                for text in premises.lines(program, found, style):
                    print(text)
        print()
        print(verdicts.summary(_problem(program, asked), bounds, report, style))
    if request.trace is not None:
        with parts.enduring("the trace"):
            _keep(program, asked, request.trace)
    if request.found is not None:
        with parts.enduring("the file of invariants"):
            _save(_problem(program, asked), asked.at_ends, request.found)
    if request.certificate is not None and not report.interrupted:
        with parts.enduring("the certificate"):
            from koord.cli.certifying import certify

            certify(program, system, asked.at_ends, request.certificate, request.left_s())
    if request.as_json:
        parts.add_to(told[-1])
    if is_debugging():
        for failure in (*report.failures, *parts.failures):
            print(failure.trace, file=sys.stderr)
    return _exit(report)


def tell_sweep(
    program: Program,
    answers: Iterable[Asked],
    request: Request,
    told: list[dict[str, object]],
) -> Exit:
    """One number of robots after the other; Ctrl-C ends it with those that are done."""
    from koord.cli import sweeps

    style = style_of(sys.stdout)
    of_all = program.problem(None, request.delta_s)
    points: list[sweeps.Point] = []
    parts = _Parts()
    if not request.as_json:
        print("\n".join(sweeps.heading(of_all, style)))
    for asked in answers:
        system, report = asked.system, asked.report
        points.append(sweeps.Point(system, report))
        told.append(_as_json(program, asked, request, parts))
        parts.add_to(told[-1])
        if not request.as_json:
            print(sweeps.row(points[-1], style), flush=True)
        if report.interrupted:
            break
    if request.plot is not None and points:
        with parts.enduring("the plot"):
            sweeps.draw(request.plot, of_all, points)
    if len(points) < len(request.fleets):
        return Exit.INTERRUPTED
    return gravest(_exit(point.report) for point in points)


def _as_json(program: Program, asked: Asked, request: Request, parts: _Parts) -> dict[str, object]:
    from koord.cli import counterexamples, fairness, slices, verdicts

    def departed(verdict: Verdict, found: Counterexample) -> Rerun:
        system = asked.system_of(verdict)
        part = f"the compiled program's run of {verdict.claim.name}"
        # Nothing would say that it does the same.
        departure: Rerun = counterexamples.not_compared()
        with parts.enduring(part):
            departure = counterexamples.rerun_of(program, system, verdict.claim, found)
        return departure

    def fair(verdict: Verdict, found: Counterexample) -> dict[str, object] | None:
        system = asked.system_of(verdict)
        told: dict[str, object] | None = None
        with parts.enduring(f"the fairness of {verdict.claim.name}"):
            told = fairness.as_json(fairness.of(program, system, verdict, found, request.left_s()))
        return told

    problem = _problem(program, asked)
    document = verdicts.as_json(problem, asked.bounds, asked.report, departed, fair)
    left_out: object = {}
    with parts.enduring("what claims do not depend on"):
        left_out = slices.left_out(asked.system, asked.report)
    return document | {"left_out": left_out}


def _problem(program: Program, asked: Asked) -> Problem:
    """What the verdicts are about."""
    system = asked.system
    return program.problem(None if asked.report.every_n else system.kinds, system.delta_s)


def _exit(report: Verification) -> Exit:
    from koord.verify.verdicts import Outcome

    if report.interrupted:
        return Exit.INTERRUPTED
    codes = {
        Outcome.HOLDS: Exit.VACUOUS if report.is_vacuous else Exit.OK,
        Outcome.VIOLATED: Exit.VIOLATED,
        Outcome.UNKNOWN: Exit.UNKNOWN,
    }
    return codes[report.outcome]


def _keep(program: Program, asked: Asked, path: str) -> None:
    """Write the trace of the first violation, the shortest of several; say so if there is none."""
    from koord.api.traces import sources_of, write_counterexample
    from koord.cli import counterexamples

    broken = [v for v in asked.report.verdicts if v.counterexample is not None]
    if not broken:
        print("koord verify: no claim is violated, so there is no trace to write", file=sys.stderr)
        return
    shortest = min(broken, key=_length)
    if asked.system_of(shortest) is asked.system:
        found = shortest.counterexample
        assert found is not None
        sources = sources_of(program)
        trace = counterexamples.trace_of(sources, asked.system, shortest.claim, found)
        write_counterexample(path, trace)
        return
    # Traces have the ends of rounds: this one has the run in which it happens in between.
    assert asked.shadows is not None
    assert shortest.counterexample is not None
    recording = asked.shadows.unshadowed(shortest.counterexample.recording)
    write_counterexample(path, counterexamples.trace_of_run(program, asked.system, recording))


def _save(problem: Problem, report: Verification, path: str) -> None:
    """Write the invariants that were found; say so if there are none."""
    from koord.cli import verdicts

    if not report.found:
        print("koord verify: no invariant was found that a proof rests on", file=sys.stderr)
        return
    text = verdicts.invariants(problem, report)
    write_atomically(path, text.encode("utf-8"))


def _length(verdict: Verdict) -> int:
    assert verdict.counterexample is not None
    return verdict.counterexample.round
