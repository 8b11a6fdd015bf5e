"""Time limits: verifications in processes, with a limit for each claim.

Engines work best on all claims together: a round is encoded once, and one claim helps to prove
another. So all are asked together first, for half of the time that one may take. What is open then
is asked claim by claim, each for what is left of its time and with what is proved as lemmas; claims
that know nothing of each other can be asked in several processes, and the answers are those of one.

Engines look at the clock now and then, and solvers have limits, but not every solver keeps to them
in every step. So each verification is in a process of its own, which is ended where it does not end
in time; what it had told of by then counts.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Sequence
from functools import partial

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax.system import System
from koord.verify.claims import claims_of, liveness_of
from koord.verify.effort import GRACE, GRACE_S, Deadline
from koord.verify.engine_names import Engine
from koord.verify.helpers import Helpers, PortableWork
from koord.verify.job_process import JobChannel
from koord.verify.obstacles import Interrupted, Obstacle, TimeUp, failed_at
from koord.verify.processes import Pool
from koord.verify.strategy.resumption import PastVerification
from koord.verify.verdicts import Bounds, Outcome, Report, Verdict

#: Whether this process has verified before. Many verify once: then the process that works loads
#: what engines are made of, as to load it here and to copy it costs more.
_has_verified = False


def load() -> None:
    """Load what all engines are made of, for all processes that are forked from now on."""
    import koord.verify.strategy.verification  # noqa: F401


def verify_apart(
    system: System,
    bounds: Bounds,
    choice: Engine | None = None,
    *,
    names: Sequence[str] = (),
    seed: int = 0,
    jobs: int = 1,
    helpers: Helpers | None = None,
    progress: Callable[[str], None] = lambda text: None,
    interrupted: Callable[[], bool] = lambda: False,
    past: PastVerification | None = None,
    settled: Callable[[Verdict], None] = lambda verdict: None,
) -> Report:
    """Verify as :func:`verify` of ``verification.py``, with a limit of ``bounds.claim_s`` each.

    ``settled`` hears verdicts as they come, where all claims are asked together.
    """
    claim_s = bounds.claim_s
    global _has_verified
    if claim_s is not None or _has_verified:
        load()
    _has_verified = True
    known = past or PastVerification()
    asking = _Asking(
        system, bounds, choice, seed, jobs, progress, interrupted, known, helpers, settled
    )
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


class _Asking(Struct, frozen=True):
    """Verifications of one system, each in a process of its own."""

    system: System
    bounds: Bounds
    choice: Engine | None
    seed: int
    jobs: int
    progress: Callable[[str], None]
    interrupted: Callable[[], bool]
    past: PastVerification = PastVerification()  #: what is known from the start
    helpers: Helpers | None = None
    settled: Callable[[Verdict], None] = lambda verdict: None

    def together(self, seconds: float | None, jobs: int, names: Sequence[str] = ()) -> Report:
        """Verify all claims, or the named ones, together."""
        started = time.monotonic()
        deadline = Deadline.after(seconds)

        def work(past: PastVerification, tell: JobChannel) -> Report:
            bounds = replace(self.bounds, timeout_s=deadline.left_s())
            return self._asked(
                tell, bounds, names=names, jobs=jobs, past=past, helpers=self.helpers
            )

        def heard(value: object) -> None:
            if isinstance(value, Verdict) and value.outcome is not Outcome.UNKNOWN:
                self.settled(value)

        report, cut, past = None, False, self.past
        with Pool(1, self.progress, self.interrupted) as pool:
            while report is None:
                lasts_s = _with_grace(deadline.left_s())
                job = pool.submit("", partial(work, past), lasts_s=lasts_s, heard=heard)
                try:
                    report = pool.answer(job)
                except KeyboardInterrupt:
                    cut = True
                if report is None:
                    before, past = past, past.told(job.noted)
                    if cut or job.is_late:
                        break
                    past = past.ended(job.end)
                    if past.begun == before.begun:
                        break  # it gets no further
        if report is None:
            spent = time.monotonic() - started
            why = "interrupted" if cut else _late(past) if job.is_late else ""
            every_n = self.choice is Engine.EVERY_N
            verdicts = self._known(past, why, spent, names, late=job.is_late)
            report = Report(verdicts, (), spent, cut, past.failures, every_n)
        return report

    def each(
        self,
        names: Sequence[str],
        seconds: float,
        deadline: Deadline,
        known: Sequence[Verdict],
        found: dict[str, Verdict],
    ) -> bool:
        """Verify claims one by one, and keep the better verdict of each.

        Whether Ctrl-C ended it. A claim whose process died goes on for what is left of its time.
        """

        def alone(name: str, past: PastVerification, own_s: float) -> ClaimQuestion:
            return ClaimQuestion(
                self.system,
                self.bounds,
                self.choice,
                name,
                tuple(known),
                self.seed,
                past,
                own_s,
                deadline,
            )

        cut = False
        until = None if deadline.at is None else deadline.at + GRACE_S
        shared_s = {name: found[name].seconds for name in names}
        pasts, left_s = dict.fromkeys(names, PastVerification()), dict.fromkeys(names, seconds)
        with Pool(self.jobs, self.progress, self.interrupted, self.helpers) as pool:
            try:
                while pasts:
                    questions = {n: alone(n, past, left_s[n]) for n, past in pasts.items()}
                    work = {
                        name: pool.submit(
                            name,
                            question,
                            portable=question,
                            lasts_s=_with_grace(left_s[name]),
                            until=until,
                        )
                        for name, question in questions.items()
                    }
                    again = {}
                    for name, answer in pool.answers(work):
                        job = work[name]
                        left_s[name] = max(0.0, left_s[name] - job.lasted_s)
                        if answer is not None:
                            (verdict,), cut = answer.verdicts, cut or answer.interrupted
                        else:
                            past = pasts[name].told(job.noted)
                            if not job.is_late:
                                is_further = past.begun != pasts[name].begun
                                past = past.ended(job.end)
                                if is_further and left_s[name] > 0:
                                    again[name] = past
                            is_late = job.is_late or left_s[name] <= 0
                            why = _late(past) if is_late else ""
                            spent = shared_s[name] + seconds - left_s[name]
                            (verdict,) = self._known(past, why, spent, [name], late=is_late)
                        if _is_better(verdict, found[name]):
                            found[name] = replace(verdict, claim=found[name].claim)
                    pasts = again
            except KeyboardInterrupt:
                cut = True
        return cut

    def _asked(
        self,
        tell: JobChannel,
        bounds: Bounds,
        *,
        names: Sequence[str],
        past: PastVerification,
        jobs: int,
        helpers: Helpers | None,
    ) -> Report:
        from koord.verify.strategy.verification import verify  # loads all engines are made of

        gc.freeze()  # which lasts, so that it need not be looked at
        return verify(
            self.system,
            bounds,
            self.choice,
            names=names,
            seed=self.seed,
            jobs=jobs,
            helpers=helpers,
            progress=tell,
            interrupted=self.interrupted,
            noted=tell.note,
            lasting=tell.lasting,
            past=past,
        )

    def _known(
        self, past: PastVerification, why: str, spent: float, names: Sequence[str], *, late: bool
    ) -> tuple[Verdict, ...]:
        """The verdicts that processes reported before they died, and reasons for the others."""
        reason = "; ".join(filter(None, [why, *map(str, past.failures)]))
        found = []
        for claim in (*claims_of(self.system), *liveness_of(self.system)):
            if names and claim.name not in names:
                continue
            verdict = past.verdict(claim.name)
            if verdict is None:
                verdict = Verdict(claim, Outcome.UNKNOWN, Engine.NONE, spent)
            if verdict.outcome is Outcome.UNKNOWN:
                more: list[Obstacle] = [failed_at(failure) for failure in past.failures]
                if late:
                    more.append(TimeUp(Engine.NONE))
                elif not more:
                    more.append(Interrupted())
                obstacles = tuple(dict.fromkeys((*verdict.obstacles, *more)))
                verdict = replace(verdict, seconds=spent, reason=reason, obstacles=obstacles)
            found.append(verdict)
        return tuple(found)


class ClaimQuestion(PortableWork, frozen=True):
    """One claim to verify for so many seconds, where verdicts on all claims are known."""

    system: System
    bounds: Bounds
    choice: Engine | None
    name: str
    known: tuple[Verdict, ...]
    seed: int
    past: PastVerification
    seconds: float
    deadline: Deadline

    def __call__(self, tell: JobChannel) -> Report:
        from koord.verify.strategy.verification import verify  # loads all engines are made of

        seconds = _least(self.seconds, self.deadline.left_s())
        return verify(
            self.system,
            replace(self.bounds, timeout_s=seconds),
            self.choice,
            names=[self.name],
            known=self.known,
            seed=self.seed,
            progress=tell,
            noted=tell.note,
            lasting=tell.lasting,
            past=self.past,
        )


def _late(past: PastVerification) -> str:
    """The reason why a process was ended: the engine whose turn it was."""
    return f"timeout; {past.who} was being asked" if past.begun else "timeout"


def _with_grace(seconds: float | None) -> float | None:
    return None if seconds is None else seconds + max(GRACE_S, GRACE * seconds)


def _least(first: float, second: float | None) -> float:
    return first if second is None else min(first, second)


def _is_better(new: Verdict, old: Verdict) -> bool:
    """Return whether a new verdict on an open claim says at least as much as the old one."""
    if new.outcome is not Outcome.UNKNOWN:
        return True
    return (-1 if new.rounds is None else new.rounds) >= (-1 if old.rounds is None else old.rounds)
