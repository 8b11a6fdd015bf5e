"""Short programs, compiled and run, for tests."""

from __future__ import annotations

from random import Random

from koord.refinement.cases import Case, SchedulePolicy, Tried, tried
from koord.syntax import core
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import dealt
from koord.traces.trace import Sources


def sources(text: str, name: str = "app.krd") -> Sources:
    return Sources(Source(name, text))


def program(text: str, name: str = "app.krd") -> core.Program:
    elaborated = load(Source(name, text))
    assert elaborated.program is not None, elaborated.diagnostics
    return elaborated.program


def ran(
    text: str,
    *,
    robots: int = 2,
    rounds: int = 3,
    policy: SchedulePolicy = SchedulePolicy.DEPLOYED,
    seed: int = 0,
    name: str = "app.krd",
) -> Tried:
    """A run of a text. It must not fall over."""
    system = dealt(program(text, name), robots)
    outcome = tried(Case(system, sources(text, name), policy, rounds, seed))
    assert not outcome.crash, outcome.crash
    return outcome


def agrees(outcome: Tried) -> None:
    """The run is one of the semantics, step by step, and was judged to its end."""
    assert outcome.judged is not None
    assert outcome.ran is not None
    assert outcome.refused is None
    assert outcome.ran.gave_up is None
    assert outcome.judged.steps > 0


def seeds(count: int) -> list[int]:
    chance = Random(2026)
    return [chance.randrange(2**31) for _ in range(count)]
