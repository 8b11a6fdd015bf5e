"""The engines are asked, about one system or about several at a time, under a live line."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from koord.cli.progress import Interruption, LiveLine
from koord.cli.requests import Request
from koord.syntax.system import System

if TYPE_CHECKING:
    from koord.verify.instants import Shadowed
    from koord.verify.proof_core import Resting
    from koord.verify.verdicts import Bounds, Verdict
    from koord.verify.verdicts import Report as Verification


class Asked(Struct, frozen=True):
    """What was found out about a system; ``shadows`` is set if instants were asked for too."""

    system: System
    bounds: Bounds
    at_ends: Verification
    between: Verification | None = None
    shadows: Shadowed | None = None

    @property
    def asks_nothing_between(self) -> bool:
        """Whether instants were asked for, and there is nothing to be said of them."""
        shadows = self.shadows
        return shadows is not None and not shadows.names and not shadows.unsaid

    @property
    def report(self) -> Verification:
        """Everything."""
        if self.between is None:
            return self.at_ends
        return replace(
            self.at_ends,
            verdicts=self.at_ends.verdicts + self.between.verdicts,
            seconds=self.at_ends.seconds + self.between.seconds,
            interrupted=self.at_ends.interrupted or self.between.interrupted,
            failures=(*self.at_ends.failures, *self.between.failures),
        )

    def system_of(self, verdict: Verdict) -> System:
        """The system whose run a counterexample is."""
        if self.shadows is None or verdict.claim.name not in self.shadows.names:
            return self.system
        return self.shadows.system


def asked_each(systems: Sequence[System], request: Request) -> Iterator[Asked]:
    """The verdicts on some systems, in order, with a live line while they are looked for.

    Several are asked about in processes of their own, ``request.jobs`` at a time. After Ctrl-C the
    answers are what is known by then, and there may be fewer of them.
    """
    check_loadable()
    # Loaded once, before there are several processes.
    import koord.verify.time_limits  # noqa: F401
    from koord.verify.processes import Pool

    with Interruption() as interruption:

        def interrupted() -> bool:
            return interruption.requested

        def asked(system: System, jobs: int, tell: Callable[[str], None]) -> Asked:
            return _asked(system, request, jobs, tell, interrupted)

        if len(systems) == 1:
            with LiveLine(sys.stderr) as line:
                found = asked(systems[0], request.jobs, line.show)
            yield found
            return
        shown = [LiveLine(None)]
        with Pool(request.jobs, lambda text: shown[0].show(text), interrupted) as pool:
            work = []
            for system in systems:
                # Beside the last one nobody else has anything to do in the end.
                jobs = request.jobs if system is systems[-1] else 1
                job = pool.hand_in(_named(system, request), partial(asked, system, jobs))
                work.append((system, job))
            for system, job in work:
                try:
                    with LiveLine(sys.stderr) as shown[0]:
                        answer = pool.answer(job)
                except KeyboardInterrupt:
                    return
                yield answer or _unanswered(system, request, job.end)


def check_loadable() -> None:
    """Raise MemoryError where Z3 would crash while it is loaded, for want of memory.

    Another process tries it, which is done only where memory is limited.
    """
    try:
        from resource import RLIM_INFINITY, RLIMIT_AS, getrlimit
    except ImportError:
        return
    if getrlimit(RLIMIT_AS)[0] == RLIM_INFINITY or "koord.verify.time_limits" in sys.modules:
        return
    child = os.fork()
    if child == 0:
        try:
            import koord.verify.engines.bits.engine
            import koord.verify.engines.horn.engine
            import koord.verify.liveness_strategy  # noqa: F401
        except BaseException:
            os._exit(1)
        os._exit(0)
    if os.waitpid(child, 0)[1] != 0:
        raise MemoryError


def _named(system: System, request: Request) -> str:
    """What tells a system from others that are asked about."""
    return f"{system.robots} robots" if len(request.fleets) > 1 else system.program.name


def _unanswered(system: System, request: Request, end: str) -> Asked:
    """What is known if the process of a system died."""
    from koord.verify.claims import claims_of, liveness_of
    from koord.verify.engine_names import Engine
    from koord.verify.obstacles import Failed
    from koord.verify.verdicts import Outcome, Report, Verdict

    claims = (*claims_of(system), *liveness_of(system))
    failed = (Failed(Engine.NONE, end),)
    verdicts = (
        Verdict(c, Outcome.UNKNOWN, Engine.NONE, 0.0, reason=end, obstacles=failed) for c in claims
    )
    return Asked(system, _bounds(request), Report(tuple(verdicts), (), 0.0))


def _bounds(request: Request) -> Bounds:
    from koord.verify.verdicts import Bounds

    return Bounds(request.rounds, request.left_s(), request.violations, request.claim_s)


def _asked(
    system: System,
    request: Request,
    jobs: int,
    tell: Callable[[str], None],
    interrupted: Callable[[], bool],
) -> Asked:
    """The verdicts on one system: if any number of robots is asked for, an example of them."""
    from koord.verify.claims import claims_of, liveness_of
    from koord.verify.effort import Deadline
    from koord.verify.strategy import Choice
    from koord.verify.time_limits import verify_apart
    from koord.verify.verdicts import Report

    known = [claim.name for claim in (*claims_of(system), *liveness_of(system))]
    shadows = None
    between: list[str] = []
    if request.instants:
        from koord.verify import instants

        shadows = instants.shadowed(system, Deadline.after(request.left_s()), request.seed)
        between = [*shadows.names, *(claim.name for claim, _ in shadows.unsaid)]
    check_names(request.properties, [*known, *between])
    every_n = request.fleets[0].any_number
    choice = Choice.EVERY_N if every_n else Choice(request.engine.value)
    bounds = _bounds(request)
    own = [name for name in request.properties if name in known]
    report = Report((), (), 0.0)
    if own or not request.properties:
        report = verify_apart(
            system,
            bounds,
            choice,
            names=own,
            seed=request.seed,
            jobs=jobs,
            progress=tell,
            interrupted=interrupted,
        )
    if shadows is None or report.interrupted:
        return Asked(system, bounds, report)
    found = instants.verified(
        shadows,
        _bounds(request),
        choice,
        wanted=lambda name: not request.properties or name in request.properties,
        seed=request.seed,
        jobs=jobs,
        progress=tell,
        interrupted=interrupted,
    )
    return Asked(system, bounds, report, found, shadows)


def resting(
    system: System, bounds: Bounds, report: Verification, request: Request
) -> Resting | None:
    """What the proofs rest on; None where Ctrl-C ended the search for proofs or for this."""
    from koord.verify.proof_core import resting as rested

    if report.interrupted:
        return None
    try:
        with LiveLine(sys.stderr) as line:
            left = replace(bounds, timeout_s=request.left_s())
            return rested(system, report.verdicts, left, seed=request.seed, progress=line.show)
    except KeyboardInterrupt:
        return None


def check_names(wanted: Sequence[str], known: Sequence[str]) -> None:
    """A misspelt name must not pass for a verdict. Raises ArgumentTypeError."""
    for word in wanted:
        if word not in known:
            listed = ", ".join(known)
            raise argparse.ArgumentTypeError(
                f"--property: there is no {word!r}; there are {listed}"
            )
