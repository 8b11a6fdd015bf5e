"""One run to be judged, as data: which program, how many robots, which schedule, which seed."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum
from random import Random

from koord.refinement.generating.profiles import CALM, GENERAL, WILD, Profile
from koord.refinement.generating.programs import system as generated_system
from koord.refinement.judging import Judged, judge
from koord.refinement.running import Ran, Target, run, target
from koord.runtime.engine.schedules import AtRandom, Deployed, Schedule
from koord.semantics.configurations import System
from koord.semantics.replay import Refused
from koord.semantics.traces.trace import Sources
from koord.syntax.source import Source

#: Seeds of the cases of one campaign are drawn from so many.
_SEEDS = 2**31

#: Values of generated programs: some double with every round.
_LARGEST = 120


class Policy(Enum):
    """How a schedule is made."""

    DEPLOYED = "deployed"  #: rotating rank, first enabled event, no skips
    RANDOM = "random"  #: any order, any enabled event, now and then a skip

    def schedule(self, rng: Random) -> Schedule:
        return Deployed() if self is Policy.DEPLOYED else AtRandom(rng)


class Sort(Enum):
    """The sorts of programs that are generated."""

    CALM = "calm"  #: little goes wrong
    GENERAL = "general"
    WILD = "wild"  #: longer bodies, in which more goes wrong

    @property
    def profile(self) -> Profile:
        return {Sort.CALM: CALM, Sort.GENERAL: GENERAL, Sort.WILD: WILD}[self]


@dataclass(frozen=True, slots=True)
class Case:
    """A run that is determined: the same case gives the same run."""

    system: System
    sources: Sources
    policy: Policy
    rounds: int
    seed: int
    largest: int | None = None  #: the size of values at which the run ends


@dataclass(frozen=True, slots=True)
class Tried:
    """What became of a case. ``crash`` is the story of a compiled program that fell over."""

    case: Case
    judged: Judged | None = None
    ran: Ran | None = None
    crash: str = ""

    @property
    def refused(self) -> Refused | None:
        return None if self.judged is None else self.judged.refused

    @property
    def failed(self) -> bool:
        """Whether the run is not one of the semantics."""
        return bool(self.crash) or self.refused is not None


def tried(case: Case, of: Target | None = None) -> Tried:
    """Compile (unless that was done before), run, and judge."""
    rng = Random(case.seed)
    try:
        made = of if of is not None else target(case.system.program)
        schedule = case.policy.schedule(rng)
        ran = run(made, case.system, case.sources, schedule, case.rounds, rng, case.largest)
    except Exception:  # whatever a wrongly compiled program does is what is looked for
        return Tried(case, crash=traceback.format_exc(limit=-4))
    return Tried(case, judge(ran), ran)


def of_program(
    sources: Sources, systems: Iterator[System], rounds: int, seeds: Random
) -> Iterator[Case]:
    """Cases of one program: with the systems in turn, every third as it would be deployed."""
    for number, system in enumerate(systems):
        policy = Policy.RANDOM if number % 3 else Policy.DEPLOYED
        yield Case(system, sources, policy, rounds, seeds.randrange(_SEEDS))


def generated(seed: int, rounds: int) -> Case:
    """The case of a generated program; everything about it hangs on the seed.

    Properties and assumptions are left out: they say nothing to what runs, and looking for a start
    that meets a random assumption would take most of the time.
    """
    rng = Random(seed)
    sort = rng.choice((Sort.CALM, Sort.CALM, Sort.GENERAL, Sort.WILD))
    system = generated_system(rng, sort.profile)
    system = replace(system, program=replace(system.program, assumptions=(), properties=()))
    policy = rng.choice((Policy.RANDOM, Policy.RANDOM, Policy.DEPLOYED))
    return Case(system, Sources(Source("generated", "")), policy, rounds, seed, _LARGEST)


def all_generated(seeds: Random, rounds: int) -> Iterator[Case]:
    """Generated cases without end."""
    while True:
        yield generated(seeds.randrange(_SEEDS), rounds)
