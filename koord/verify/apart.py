"""Verifications that end when they have to, and a time limit for each claim.

Engines work best on all claims together: a round is encoded once, and one claim helps to prove
another. So all are asked together first, for half of the time that one may take. What is open then
is asked claim by claim, each for what is left of its time and with what is proved as lemmas; claims
that know nothing of each other can be asked in several processes, and the answers are those of one.

Engines look at the clock now and then, and solvers have limits, but not every solver keeps to them
in every step. So each verification is in a process of its own, which is ended where it does not end
in time; what it had told of by then counts.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from koord.semantics.configurations import System
from koord.verify.claims import claims_of, liveness_of
from koord.verify.pool import DIED, Job, Pool, Teller
from koord.verify.portfolio import Choice, verify
from koord.verify.solving import Deadline
from koord.verify.verdicts import Bounds, Engine, Outcome, Report, Verdict

#: What part of its time a process may take longer to end in good order, and in seconds at least.
GRACE, GRACE_S = 0.05, 0.1


def verify_apart(
    system: System,
    bounds: Bounds,
    choice: Choice = Choice.AUTO,
    *,
    names: Sequence[str] = (),
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[str], None] = lambda text: None,
    interrupted: Callable[[], bool] = lambda: False,
) -> Report:
    """As :func:`koord.verify.portfolio.verify`, with ``bounds.claim_s`` seconds for each claim."""
    asking = _Asking(system, bounds, choice, seed, jobs, progress, interrupted)
    claim_s = bounds.claim_s
    if claim_s is None:
        return asking.together(bounds.timeout_s, jobs, names)
    started = time.monotonic()
    deadline = Deadline.after(bounds.timeout_s)
    count = len(claims_of(system)) + len(liveness_of(system))
    shared_s = claim_s / 2 if count > 1 else claim_s
    report = asking.together(_least(shared_s, bounds.timeout_s), jobs)
    found = {verdict.claim.name: verdict for verdict in report.verdicts}
    wanted = [name for name in found if not names or name in names]
    left = [name for name in wanted if found[name].outcome is Outcome.UNKNOWN]
    cut = report.interrupted
    if left and count > 1 and not cut:
        own_s = max(0.0, claim_s - (time.monotonic() - started))
        cut = asking.each(left, own_s, deadline, report.verdicts, found)
    verdicts = tuple(found[name] for name in wanted)
    return replace(report, verdicts=verdicts, interrupted=cut, seconds=time.monotonic() - started)


@dataclass(frozen=True, slots=True)
class _Asking:
    """Verifications of one system, each in a process of its own."""

    system: System
    bounds: Bounds
    choice: Choice
    seed: int
    jobs: int
    progress: Callable[[str], None]
    interrupted: Callable[[], bool]

    def together(self, seconds: float | None, jobs: int, names: Sequence[str] = ()) -> Report:
        """All claims, or the named ones."""
        started = time.monotonic()
        bounds = replace(self.bounds, timeout_s=seconds)

        def work(tell: Teller) -> Report:
            return self._asked(tell, bounds, names=names, jobs=jobs)

        report, cut = None, False
        with Pool(1, self.progress, self.interrupted) as pool:
            job = pool.hand_in("", work, lasts_s=_with_grace(seconds))
            try:
                report = pool.answer(job)
            except KeyboardInterrupt:
                cut = True
        if report is None:
            spent = time.monotonic() - started
            verdicts = self._noted(job, cut, spent, names)
            report = Report(verdicts, (), spent, cut, every_n=self.choice is Choice.EVERY_N)
        return report

    def each(
        self,
        names: Sequence[str],
        seconds: float,
        deadline: Deadline,
        known: Sequence[Verdict],
        found: dict[str, Verdict],
    ) -> bool:
        """Some claims by themselves: what is better than what was found is put there.

        Whether Ctrl-C ended it.
        """
        bounds = replace(self.bounds, timeout_s=seconds)

        def alone(name: str, tell: Teller) -> Report:
            limited = replace(bounds, timeout_s=_least(seconds, deadline.left_s()))
            return self._asked(tell, limited, names=[name], known=known)

        cut = False
        grace_s = _with_grace(seconds)
        until = None if deadline.at is None else deadline.at + GRACE_S
        with Pool(self.jobs, self.progress, self.interrupted) as pool:
            work = {
                name: pool.hand_in(name, partial(alone, name), lasts_s=grace_s, until=until)
                for name in names
            }
            try:
                for name, answer in pool.answers(work):
                    if answer is not None:
                        (verdict,), cut = answer.verdicts, cut or answer.interrupted
                    else:
                        spent = found[name].seconds + seconds
                        (verdict,) = self._noted(work[name], False, spent, [name])
                    if _is_better(verdict, found[name]):
                        found[name] = replace(verdict, claim=found[name].claim)
            except KeyboardInterrupt:
                cut = True
        return cut

    def _asked(
        self,
        tell: Teller,
        bounds: Bounds,
        *,
        names: Sequence[str],
        known: Sequence[Verdict] = (),
        jobs: int = 1,
    ) -> Report:
        return verify(
            self.system,
            bounds,
            self.choice,
            names=names,
            known=known,
            seed=self.seed,
            jobs=jobs,
            progress=tell,
            interrupted=self.interrupted,
            noted=tell.note,
        )

    def _noted(
        self, job: Job[Report], cut: bool, spent: float, names: Sequence[str]
    ) -> tuple[Verdict, ...]:
        """What a process had told of before it was ended, or died."""
        told = {v.claim.name: v for v in job.noted if isinstance(v, Verdict)}
        why = "interrupted" if cut else "timeout" if job.is_late else DIED
        found = []
        for claim in (*claims_of(self.system), *liveness_of(self.system)):
            if names and claim.name not in names:
                continue
            verdict = told.get(claim.name)
            if verdict is None:
                verdict = Verdict(claim, Outcome.UNKNOWN, Engine.NONE, spent)
            if verdict.outcome is Outcome.UNKNOWN:
                verdict = replace(verdict, seconds=spent, reason=why)
            found.append(verdict)
        return tuple(found)


def _with_grace(seconds: float | None) -> float | None:
    return None if seconds is None else seconds + max(GRACE_S, GRACE * seconds)


def _least(first: float, second: float | None) -> float:
    return first if second is None else min(first, second)


def _is_better(new: Verdict, old: Verdict) -> bool:
    """Whether an answer to a claim that is open says at least as much as what was known."""
    if new.outcome is not Outcome.UNKNOWN:
        return True
    return (-1 if new.rounds is None else new.rounds) >= (-1 if old.rounds is None else old.rounds)
