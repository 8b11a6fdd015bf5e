"""A time limit for each claim: who takes long is given up, and keeps nobody else waiting.

Engines work best on all claims together: a round is encoded once, and one claim helps to prove
another. So all are asked together first, for as long as one may take. What is open then is asked
claim by claim, each with its own time and with what is proved as lemmas; claims that know nothing
of each other can be asked in several processes, and the answers are those of one.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from koord.semantics.configurations import System
from koord.verify.pool import Pool, Progress
from koord.verify.portfolio import Choice, verify
from koord.verify.solving import Deadline
from koord.verify.verdicts import Bounds, Outcome, Report, Verdict


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
    ask = partial(verify, choice=choice, seed=seed, interrupted=interrupted)
    claim_s = bounds.claim_s
    if claim_s is None:
        return ask(system, bounds, names=names, jobs=jobs, progress=progress)
    started = time.monotonic()
    deadline = Deadline.after(bounds.timeout_s)
    together = replace(bounds, timeout_s=_least(claim_s, bounds.timeout_s))
    report = ask(system, together, jobs=jobs, progress=progress)
    found = {verdict.claim.name: verdict for verdict in report.verdicts}
    wanted = [name for name in found if not names or name in names]
    left = [name for name in wanted if found[name].outcome is Outcome.UNKNOWN]

    def alone(name: str, tell: Progress) -> Report:
        limited = replace(bounds, timeout_s=_least(claim_s, deadline.left_s()))
        return ask(system, limited, names=[name], known=report.verdicts, progress=tell)

    cut = report.interrupted
    if left and len(found) > 1 and not cut:
        with Pool(jobs, progress, interrupted) as pool:
            asked = {name: pool.hand_in(name, partial(alone, name)) for name in left}
            try:
                for name, answer in pool.answers(asked):
                    if answer is None:
                        continue  # its process died: what was known of the claim stands
                    (verdict,), cut = answer.verdicts, cut or answer.interrupted
                    if _is_better(verdict, found[name]):
                        found[name] = replace(verdict, claim=found[name].claim)
            except KeyboardInterrupt:
                cut = True
    verdicts = tuple(found[name] for name in wanted)
    return replace(report, verdicts=verdicts, interrupted=cut, seconds=time.monotonic() - started)


def _least(first: float, second: float | None) -> float:
    return first if second is None else min(first, second)


def _is_better(new: Verdict, old: Verdict) -> bool:
    """Whether an answer to a claim that is open says more than what was known."""
    if new.outcome is not Outcome.UNKNOWN:
        return True
    return (-1 if new.rounds is None else new.rounds) > (-1 if old.rounds is None else old.rounds)
