"""One run to be judged, as data: which program, how many robots, which schedule, which seed."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from enum import Enum
from random import Random

from msgspec import Struct
from msgspec.structs import replace

from koord.refinement.deployed import Expedition, over_network, over_udp
from koord.refinement.generating import profiles
from koord.refinement.generating.profiles import GENERAL, WILD, Profile
from koord.refinement.generating.programs import system as generated_system
from koord.refinement.judging import Judged, judge
from koord.refinement.running import Compiled, CompiledRun, ready, run
from koord.runtime.chaos.faults import CALM, Faults
from koord.runtime.engine import AtRandom, Deployed, Schedule, Unheard
from koord.syntax.source import Source
from koord.syntax.system import System
from koord.traces.replay import Refused
from koord.traces.trace import Sources

#: Seeds of the cases of one campaign are drawn from so many.
_SEEDS = 2**31

#: Values of generated programs: some double with every round.
_LARGEST = 120


class SchedulePolicy(Enum):
    """How a schedule is made."""

    DEPLOYED = "deployed"  #: rotating rank, first enabled event, no skips
    RANDOM = "random"  #: any order, any enabled event, now and then a skip

    def schedule(self, rng: Random) -> Schedule:
        return Deployed() if self is SchedulePolicy.DEPLOYED else AtRandom(rng)


class Target(Enum):
    """What runs a compiled program."""

    ENGINE = "engine"  #: all robots in one process, without messages
    NETWORK = "network"  #: deployed robots on a simulated network, in virtual time
    UDP = "udp"  #: deployed robots as processes that talk over UDP


class ProgramFamily(Enum):
    """The sorts of programs that are generated."""

    CALM = "calm"  #: little goes wrong
    GENERAL = "general"
    WILD = "wild"  #: longer bodies, in which more goes wrong

    @property
    def profile(self) -> Profile:
        return {
            ProgramFamily.CALM: profiles.CALM,
            ProgramFamily.GENERAL: GENERAL,
            ProgramFamily.WILD: WILD,
        }[self]


class Case(Struct, frozen=True):
    """A run that is determined: the same case gives the same run, but for processes."""

    system: System
    sources: Sources
    policy: SchedulePolicy
    rounds: int
    seed: int
    largest: int | None = None  #: the size of values at which the run ends
    target: Target = Target.ENGINE
    faults: Faults = CALM


class Tried(Struct, frozen=True):
    """What became of a case. ``crash`` is the story of a compiled program that fell over."""

    case: Case
    judged: Judged | None = None
    ran: CompiledRun | None = None
    crash: str = ""

    @property
    def refused(self) -> Refused | None:
        return None if self.judged is None else self.judged.refused

    @property
    def failed(self) -> bool:
        """Whether the run is not one of the semantics."""
        return bool(self.crash) or self.refused is not None


def tried(case: Case, of: Compiled | None = None) -> Tried:
    """Compile (unless that was done before), run, and judge."""
    try:
        ran = _run(case, of if of is not None else ready(case.system.program))
    except Exception:  # whatever a wrongly compiled program does is what is looked for
        return Tried(case, crash=traceback.format_exc(limit=-4))
    return Tried(case, judge(ran), ran)


def _run(case: Case, made: Compiled) -> CompiledRun:
    if case.target is Target.ENGINE:
        rng = Random(case.seed)
        schedule = case.policy.schedule(rng)
        if case.faults != CALM:
            schedule = Unheard(schedule, rng, case.faults.loss, case.faults.crashes_per_s > 0)
        return run(made, case.system, case.sources, schedule, case.rounds, rng, case.largest)
    expedition = Expedition(
        made, case.system, case.sources, case.rounds, case.seed, case.faults, case.largest
    )
    return over_network(expedition) if case.target is Target.NETWORK else over_udp(expedition)


def of_program(
    sources: Sources,
    systems: Iterator[System],
    rounds: int,
    seeds: Random,
    target: Target = Target.ENGINE,
    faults: Faults = CALM,
) -> Iterator[Case]:
    """Cases of one program: with the systems in turn, every third as it would be deployed."""
    for number, system in enumerate(systems):
        policy = SchedulePolicy.RANDOM if number % 3 else SchedulePolicy.DEPLOYED
        seed = seeds.randrange(_SEEDS)
        yield Case(system, sources, policy, rounds, seed, target=target, faults=faults)


def generated(
    seed: int, rounds: int, target: Target = Target.ENGINE, faults: Faults = CALM
) -> Case:
    """The case of a generated program; everything about it hangs on the seed.

    Properties and assumptions are left out: they say nothing to what runs, and looking for a start
    that meets a random assumption would take most of the time.
    """
    rng = Random(seed)
    sort = rng.choice(
        (ProgramFamily.CALM, ProgramFamily.CALM, ProgramFamily.GENERAL, ProgramFamily.WILD)
    )
    system = generated_system(rng, sort.profile)
    system = replace(system, program=replace(system.program, assumptions=(), properties=()))
    policy = rng.choice((SchedulePolicy.RANDOM, SchedulePolicy.RANDOM, SchedulePolicy.DEPLOYED))
    sources = Sources(Source("generated", ""))
    return Case(system, sources, policy, rounds, seed, _LARGEST, target, faults)


def all_generated(
    seeds: Random, rounds: int, target: Target = Target.ENGINE, faults: Faults = CALM
) -> Iterator[Case]:
    """Generated cases without end."""
    while True:
        yield generated(seeds.randrange(_SEEDS), rounds, target, faults)
