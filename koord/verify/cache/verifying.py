"""Verification with kept verdicts: asked is only what is not known."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import cached_property

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax.system import System
from koord.verify.cache.dependence import Dependences, Question
from koord.verify.cache.kept import Known, VerdictCache
from koord.verify.claims import Claim
from koord.verify.engine_names import Engine
from koord.verify.strategy.resumption import PastVerification
from koord.verify.verdicts import Bounds, Report, Substance


class CachedVerification(Struct, frozen=True, dict=True):
    """A verification of one system, by what a cache knows of it.

    ``names`` are those of the claims that are asked about; none are all. ``started`` is when it
    began, as :func:`time.monotonic` counts.
    """

    cache: VerdictCache
    dependences: Dependences
    bounds: Bounds
    names: frozenset[str]
    known: Mapping[Claim, Known]
    started: float

    @classmethod
    def begun(
        cls,
        cache: VerdictCache,
        system: System,
        bounds: Bounds,
        choice: Engine | None = None,
        *,
        names: frozenset[str] = frozenset(),
        seed: int = 0,
        version: str = "",
    ) -> CachedVerification:
        """Look up what is known of a system. ``version`` is that of all that may answer."""
        started = time.monotonic()
        dependences = Dependences(system, Question(bounds.rounds, choice, seed, version))
        known = cache.known(dependences)
        return cls(cache, dependences, bounds, names, known, started)

    @property
    def past(self) -> PastVerification:
        """All that is known, also of claims that are not asked about: they serve as lemmas."""
        verdicts = tuple(each.verdict for each in self.known.values())
        return PastVerification(
            verdicts,
            reaching=self.cache.reaching(self.dependences),
            substance=self.substance,
            likely=self.cache.likely(self.dependences, self.known),
            keeps_runs=True,
        )

    @cached_property
    def substance(self) -> Substance:
        """What is known to say something; nothing where only some claims are asked about."""
        if self.names:
            return Substance()
        verdicts = [each.verdict for each in self.known.values()]
        return self.cache.substance(self.dependences, verdicts)

    @cached_property
    def answer(self) -> Report | None:
        """The report, if everything is known; None if engines have to be asked."""
        claims = self.dependences.claims
        asked = [claim for claim in claims if not self.names or claim.name in self.names]
        if not all(claim in self.known for claim in asked):
            return None
        verdicts = tuple(self.known[claim].verdict for claim in asked)
        every_n = self.dependences.question.engine is Engine.EVERY_N
        if self.substance.happens and self.substance.claims >= {each.name for each in asked}:
            return Report(verdicts, (), 0.0, every_n=every_n)
        kept = self.cache.vacuities(self.dependences, verdicts, self.names)
        if kept is None:
            return None
        return Report(verdicts, kept.vacuities, 0.0, every_n=every_n)

    def ended(self, report: Report) -> Report:
        """Keep what engines have found, and return their report."""
        if self.answer is None:
            self.cache.keep(self.dependences, report, self.bounds, self.known.values())
            self.cache.keep_vacuities(self.dependences, report, self.names)
            self.cache.keep_reaching(self.dependences, report)
            if not self.names:
                self.cache.keep_substance(self.dependences, report)
        return replace(report, seconds=time.monotonic() - self.started)
