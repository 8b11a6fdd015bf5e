"""Verification with a cache, in this process."""

from __future__ import annotations

from msgspec.structs import replace

from koord.stores.store import MemoryStore
from koord.syntax.system import System
from koord.verify.cache.dependence import Dependences, Question
from koord.verify.cache.kept import VerdictCache
from koord.verify.cache.verifying import CachedVerification
from koord.verify.engine_names import Engine
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Report

SHORT = Bounds(rounds=4)


def new_cache() -> VerdictCache:
    return VerdictCache(MemoryStore())


def verified(
    cache: VerdictCache,
    system: System,
    bounds: Bounds = SHORT,
    choice: Engine | None = None,
    names: frozenset[str] = frozenset(),
) -> Report:
    """The report on a system; engines are asked where the cache does not know."""
    cached = CachedVerification.begun(cache, system, bounds, choice, names=names)
    found = cached.answer
    if found is None:
        found = verify(system, bounds, choice, names=sorted(names), past=cached.past)
    return cached.ended(found)


def kept(report: Report) -> set[str]:
    """The claims that no engine was asked about."""
    return {verdict.claim.name for verdict in report.verdicts if verdict.kept}


def dependences(system: System, rounds: int = 4) -> Dependences:
    return Dependences(system, Question(rounds))


def without_times(report: Report) -> Report:
    """A report but for how long it took and what was kept."""
    verdicts = tuple(replace(v, seconds=0.0, kept=False, step=None) for v in report.verdicts)
    return replace(
        report, verdicts=verdicts, seconds=0.0, of_slice=False, reaching=(), substance=None
    )
