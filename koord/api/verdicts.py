"""Verdicts in the public API: answers to claims, with counterexamples and details."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from typing import TYPE_CHECKING

from msgspec import Struct, field, to_builtins

from koord.api.programs import Program
from koord.api.results import Result, html_table
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.traces.trace import Numbers, Sources, Violation, ViolationKind, traced
from koord.traces.trace import Trace as Recorded
from koord.verify import obstacles
from koord.verify.claims import Claim, ClaimKind, rule_of
from koord.verify.engine_names import Engine
from koord.verify.obstacles import Failure, failure_of
from koord.verify.verdicts import (
    Counterexample,
    Outcome,
)
from koord.verify.verdicts import Verdict as Found

if TYPE_CHECKING:
    from koord.api import verdict_forms as forms
    from koord.api.fairness import Fair
    from koord.api.traces import Trace
    from koord.refinement.compiled_replay import Rerun
    from koord.semantics.configurations import Configuration
    from koord.semantics.domain import Constant
    from koord.semantics.recordings import Step
    from koord.verify.instants import Shadowed

_KINDS = {
    ClaimKind.PROPERTY: ViolationKind.PROPERTY,
    ClaimKind.CONTRACT: ViolationKind.CONTRACT,
    ClaimKind.LOST_UPDATE: ViolationKind.LOST_UPDATE,
    ClaimKind.LIVENESS: ViolationKind.PROPERTY,
}


class Parts(Struct):
    """Optional parts of a report: one that fails is recorded, and the others go on."""

    tell: Callable[[Failure], None] = lambda failure: None
    failures: list[Failure] = field(default_factory=list)

    @contextmanager
    def enduring(self, part: str) -> Iterator[None]:
        """Within the context, an exception only ends this part of the report.

        Not so one for which the input, or this machine, is to blame.
        """
        try:
            yield
        except (KoordError, OSError, MemoryError):
            raise
        except Exception as error:
            failure = failure_of(part, error)
            self.failures.append(failure)
            self.tell(failure)


class Verdict(Result, frozen=True):
    """The answer to one claim: a property, a contract, no fault, no lost update.

    ``found`` is what an engine answered, ``system`` that whose run a counterexample is.
    """

    found: Found
    program: Program
    system: System
    shadows: Shadowed | None = None  #: of a claim about what is between the ends of rounds
    ends_at: float | None = None

    @property
    def name(self) -> str:
        """The name of the claim."""
        return self.found.claim.name

    @property
    def outcome(self) -> Outcome:
        """The outcome: holds, violated or unknown."""
        return self.found.outcome

    @property
    def holds(self) -> bool:
        """True if the claim is known to hold; see ``rounds``."""
        return self.outcome is Outcome.HOLDS

    @property
    def rounds(self) -> int | None:
        """The number of rounds through which it is known to hold; None: in all, if it ``holds``."""
        return self.found.rounds

    @property
    def engine(self) -> Engine:
        """The engine that gave the answer."""
        return self.found.engine

    @property
    def reason(self) -> str:
        """The reason for an unknown outcome."""
        return self.found.reason

    @property
    def seconds(self) -> float:
        """The time spent on the answer, in seconds of wall time."""
        return self.found.seconds

    @property
    def kept(self) -> bool:
        """True if a cache knew the answer, so that no engine was asked."""
        return self.found.kept

    @property
    def counterexample(self) -> Trace | None:
        """A run that breaks the claim, for :func:`koord.replay`; None if it is not violated."""
        return next(iter(self.counterexamples), None)

    @property
    def counterexamples(self) -> tuple[Trace, ...]:
        """The different counterexamples that were found."""
        from koord.api.traces import Trace

        first = self.found.counterexample
        runs = () if first is None else (first, *self.found.others)
        return tuple(Trace(self._own(run)) for run in runs)

    def recorded(self, run: Counterexample) -> Recorded:
        """A counterexample as a trace of the system that it is a run of."""
        from koord.api.traces import sources_of

        return trace_of(sources_of(self.program), self.system, self.found.claim, run)

    def _own(self, run: Counterexample) -> Recorded:
        """The counterexample as a trace of the program as written.

        Traces have the ends of rounds: of what happens in between it has the run in which it does.
        """
        if self.shadows is None:
            return self.recorded(run)
        from koord.api.traces import sources_of

        recording = self.shadows.unshadowed(run.recording)
        sources = sources_of(self.program)
        return traced(sources, self.shadows.original, Numbers.EXACT, recording, None)

    def rerun(self, run: Counterexample) -> Rerun:
        """Rerun a counterexample on the compiled program: its first difference, if there is one."""
        from koord.refinement.compiled_replay import rerun

        return rerun(self.recorded(run))

    @property
    def rule(self) -> str:
        """The rule that a violation of the claim breaks."""
        return rule_of(self.found.claim)

    @property
    def obstacles(self) -> tuple[str, ...]:
        """The obstacles to an answer, and their cures, in words."""
        return tuple(obstacles.lines(self.found.obstacles, self.name))

    def instant(self, run: Counterexample) -> Fraction | None:
        """The instant in the environment's turn at which a claim about instants breaks.

        In seconds from the turn's start; None for other claims.
        """
        from koord.verify.instants import instant_of

        return instant_of(run.recording)

    def fairness(self, run: Counterexample) -> Fair | None:
        """Explain why a lasso is fair; None for a counterexample that ends."""
        if run.recording.loop is None:
            return None
        from koord.api.fairness import fairness_of

        left_s = None if self.ends_at is None else max(0.0, self.ends_at - time.monotonic())
        return fairness_of(self.program, self.system, self.found, run, left_s)

    def steps(self, run: Counterexample) -> Iterator[Step]:
        """Yield the steps of a counterexample, executed by the reference semantics."""
        from koord.semantics.recordings import execute

        return execute(Numbers.EXACT.domain, self.system, run.recording)

    def left_behind(
        self, first: Configuration[Constant], last: Configuration[Constant]
    ) -> tuple[str, ...]:
        """The places of auxiliary variables to which a loop does not return."""
        from koord.traces.lassos import left_behind

        return left_behind(self.system, first, last)

    def to_dict(self) -> dict[str, object]:
        """The verdict as plain data: one of the claims of :meth:`VerifyReport.to_dict`."""
        plain: dict[str, object] = to_builtins(self.form(Parts()))
        return plain

    def form(self, parts: Parts) -> forms.Claim:
        """The verdict as JSON has it; ``parts`` records failures of its details."""
        from koord.api.verdict_documents import claim_form

        first, others = self.found.counterexample, self.found.others
        return claim_form(
            self.name,
            self.found,
            None if first is None else self._violation(first, parts),
            [self._violation(other, parts) for other in others],
        )

    def _violation(self, run: Counterexample, parts: Parts) -> forms.Violation:
        from koord.api.verdict_documents import violation_form
        from koord.refinement.compiled_replay import Departure

        # Where it fails, nothing says that the compiled program does the same.
        departure: Rerun = Departure(0, "the run could not be compared")
        with parts.enduring(f"the compiled program's run of {self.name}"):
            departure = self.rerun(run)
        fair = None
        with parts.enduring(f"the fairness of {self.name}"):
            why = self.fairness(run)
            if why is not None:
                from koord.api.fairness import fairness_form

                fair = fairness_form(why)
        return violation_form(run, self.found.robots, departure, fair)

    def __repr__(self) -> str:
        reach = ""
        if self.outcome is not Outcome.VIOLATED and self.rounds is not None:
            reach = f" through round {self.rounds}"
        elif self.found.counterexample is not None:
            reach = f" in round {self.found.counterexample.round}"
        elif self.holds:
            reach = " in every round"
        by = "" if self.engine is Engine.NONE else f" ({self.engine.value})"
        return f"<Verdict {self.name}: {self.outcome.value}{reach}{by}>"

    def _repr_html_(self) -> str:
        run, found = self.counterexample, self.found.counterexample
        if run is None or found is None:
            return html_table(repr(self), (), ())
        heading = f"{self.name}: {found.detail} [{self.rule}]"
        return html_table(heading, (), ()) + run._repr_html_()


def trace_of(sources: Sources, system: System, claim: Claim, run: Counterexample) -> Recorded:
    """A counterexample as a trace."""
    kind = _KINDS.get(claim.kind)
    violation = None
    if kind is not None:
        violation = Violation(kind, claim.subject or claim.name, run.round - 1, run.robot)
    return traced(sources, system, Numbers.EXACT, run.recording, violation)
