"""Reports of verifications: verdicts, vacuities and other findings."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec.structs import replace

from koord.api.programs import Program
from koord.api.progress import Progress
from koord.api.results import Html, Result, html_details, html_outcome, html_table
from koord.api.verdicts import Parts, Verdict
from koord.syntax.problem import Problem
from koord.syntax.source import visible
from koord.syntax.system import System
from koord.verify.engine_names import Engine
from koord.verify.obstacles import Failure
from koord.verify.verdicts import Bounds, Outcome, Report, Vacuity
from koord.verify.verdicts import Verdict as Found

if TYPE_CHECKING:
    from koord.api import verdict_forms as forms
    from koord.api.cones import Cones
    from koord.api.traces import Trace
    from koord.api.wcet import ExecutionTimes
    from koord.verify.instants import Shadowed
    from koord.verify.proof_core import ProofCore


class VerdictProgress(Progress, frozen=True, kw_only=True):
    """Progress of the verification of one system: there is a verdict on one more claim.

    ``report`` has the verdicts that are known by then, without what makes them vacuous.
    """

    report: VerifyReport


class VerifyReport(Result, frozen=True):
    """The verdicts on one program with its robots, and other findings.

    ``between`` and ``shadows`` are there if instants between the ends of rounds were asked about,
    ``rests_on`` if it was asked what the proofs need, ``execution_times`` if it was asked how long
    turns take. ``failed`` is what failed beside verdicts.
    """

    program: Program
    system: System
    bounds: Bounds
    at_ends: Report
    between: Report | None = None
    shadows: Shadowed | None = None
    rests_on: ProofCore | None = None
    failed: tuple[Failure, ...] = ()
    ends_at: float | None = None
    execution_times: ExecutionTimes | None = None

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """The verdicts, one for each claim."""
        return tuple(self._verdict(found) for found in self.report.verdicts)

    def verdict(self, name: str) -> Verdict:
        """The verdict on the claim of that name. Raises KeyError if there is none."""
        for verdict in self.verdicts:
            if verdict.name == name:
                return verdict
        raise KeyError(name)

    @property
    def outcome(self) -> Outcome:
        """The overall outcome: violated if one claim is; else unknown if one is; else holds."""
        return self.report.outcome

    @property
    def holds(self) -> bool:
        """True if every claim holds."""
        return self.outcome is Outcome.HOLDS

    @property
    def vacuities(self) -> tuple[Vacuity, ...]:
        """The vacuities: reasons why verdicts say less than they seem to."""
        return self.report.vacuities

    @property
    def engines(self) -> tuple[Engine, ...]:
        """The engines that gave the verdicts."""
        used = (verdict.engine for verdict in self.report.verdicts)
        return tuple(dict.fromkeys(engine for engine in used if engine is not Engine.NONE))

    @property
    def not_looked_at(self) -> tuple[str, ...]:
        """The events and suppositions whose reachability is unknown, as the search was given up."""
        return tuple(each.what.of(each.subject) for each in self.report.unlooked)

    @property
    def interrupted(self) -> bool:
        """True if the verification was cancelled before it was complete."""
        return self.report.interrupted

    @property
    def seconds(self) -> float:
        """The duration in seconds of wall time."""
        return self.report.seconds

    @property
    def counterexample(self) -> Trace | None:
        """The shortest run that breaks a claim; None if no claim is violated."""
        broken = [(v, v.found.counterexample) for v in self.verdicts]
        runs = [(run.round, number) for number, (_, run) in enumerate(broken) if run is not None]
        return self.verdicts[min(runs)[1]].counterexample if runs else None

    @property
    def invariants(self) -> str:
        """The inferred invariants, as a file of properties; "" if there are none."""
        found = self.at_ends
        if not found.lemmas:
            return ""
        from koord.syntax.printing.quoting import Quoting

        problem, quoting = self.problem, Quoting.of(self.system.program)
        proofs = [verdict for verdict in found.verdicts if verdict.lemmas]
        if all(verdict.engine is Engine.EVERY_N for verdict in proofs):
            problem = replace(problem, kinds=None)
        lines = [f"# Found for {visible(str(problem))}:", "# together they hold in every round."]
        lines += [quoting.invariant(x, f"Found{k}") for k, x in enumerate(found.lemmas, start=1)]
        return "\n".join(lines) + "\n"

    @property
    def found_invariants(self) -> tuple[str, ...]:
        """The inferred invariants, as Koord.

        Those of the ends of rounds alone begin with ``at round:``.
        """
        found: dict[str, None] = {}
        for verdict in self.verdicts:
            if verdict.found.lemmas:
                from koord.syntax.printing.quoting import Quoting

                quoting = Quoting.of(verdict.system.program)
                found |= dict.fromkeys(map(quoting.invariant, verdict.found.lemmas))
        return tuple(found)

    @property
    def problem(self) -> Problem:
        """The program with its robots and settings: the subject of the verdicts."""
        system = self.system
        kinds = None if self.report.every_n else system.kinds
        return self.program.problem(kinds, system.delta_s)

    @property
    def report(self) -> Report:
        """The engines' report, on ends of rounds and on instants between them."""
        if self.between is None:
            return self.at_ends
        return replace(
            self.at_ends,
            verdicts=self.at_ends.verdicts + self.between.verdicts,
            seconds=self.at_ends.seconds + self.between.seconds,
            interrupted=self.at_ends.interrupted or self.between.interrupted,
            failures=(*self.at_ends.failures, *self.between.failures),
        )

    @property
    def cones(self) -> Cones:
        """The parts that each claim does not depend on."""
        from koord.api.cones import cones_of  # by slices, which verdicts alone do not need

        return cones_of(self.system, self.report)

    @property
    def is_vacuous(self) -> bool:
        """True if some vacuity is certain."""
        return self.report.is_vacuous

    @property
    def asks_nothing_between(self) -> bool:
        """True if instants were asked about, but no claim is about them."""
        shadows = self.shadows
        return shadows is not None and not shadows.names and not shadows.unsaid

    def _verdict(self, found: Found) -> Verdict:
        shadows = self.shadows
        if shadows is None or found.claim.name not in shadows.names:
            system = found.broken_system(self.system)
            return Verdict(found, self.program, system, None, self.ends_at)
        system = found.broken_system(shadows.system)
        shadows = replace(shadows, original=found.broken_system(shadows.original))
        return Verdict(found, self.program, system, shadows, self.ends_at)

    def to_dict(self) -> dict[str, object]:
        """The report as plain data, as ``koord verify --json`` prints it."""
        from koord.api.verdict_documents import reports_dict

        return reports_dict([self.form(Parts())])

    @property
    def failures(self) -> tuple[Failure, ...]:
        """The failures of engines, and of optional parts of the report."""
        return (*self.report.failures, *self.failed)

    def form(self, parts: Parts) -> forms.Report:
        """The report as JSON has it, see :meth:`to_dict`; ``parts`` records details that fail."""
        return self.form_of([verdict.form(parts) for verdict in self.verdicts], parts)

    def form_of(self, claims: list[forms.Claim], parts: Parts) -> forms.Report:
        """The same with these claims."""
        from koord.api.verdict_documents import report_form

        left_out: dict[str, list[str]] = {}
        with parts.enduring("what claims do not depend on"):
            left_out = self.cones.left_out
        return report_form(
            self.problem,
            self.report,
            self.bounds,
            claims,
            found_invariants=self.found_invariants,
            failures=(*self.failures, *parts.failures),
            left_out=left_out,
            rests_on=self.rests_on,
            execution_times=self.execution_times,
        )

    def __repr__(self) -> str:
        lines = "".join(f"\n  {verdict!r}" for verdict in self.verdicts)
        vacuous = ", but vacuously" if self.report.is_vacuous and self.holds else ""
        return f"<VerifyReport {self.problem}: {self.outcome.value}{vacuous}>{lines}"

    def _repr_html_(self) -> str:
        rows = [
            (
                v.name,
                Html(html_outcome(v.outcome.value)),
                _reach(v),
                v.engine.value,
                v.reason,
            )
            for v in self.verdicts
        ]
        columns = ("claim", "outcome", "how far", "engine", "reason")
        shown = [html_table(f"{self.problem}: {self.outcome.value}", columns, rows)]
        if self.vacuities:
            said = [(one.told,) for one in self.vacuities]
            heading = "verdicts say less than they seem to:" if self.is_vacuous else "seen so far:"
            shown.append(html_table(heading, ("",), said))
        for verdict in self.verdicts:
            if verdict.found.counterexample is not None:
                heading = f"a run that breaks {verdict.name}"
                shown.append(html_details(heading, verdict._repr_html_()))
        return "".join(shown)


def _reach(verdict: Verdict) -> str:
    """How far a verdict reaches, in words."""
    run = verdict.found.counterexample
    if run is not None:
        return "in a run without end" if run.recording.loop is not None else f"round {run.round}"
    if verdict.rounds is not None:
        return f"through round {verdict.rounds}"
    if not verdict.holds:
        return ""
    every = ", for every N" if verdict.engine is Engine.EVERY_N else ""
    return f"in every round{every}"
