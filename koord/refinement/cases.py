"""Test cases of refinement as data, and their reduction to smaller failing ones."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator
from enum import Enum
from random import Random
from typing import TypeVar

from msgspec import Struct
from msgspec.structs import replace

from koord.refinement.deployed import Expedition, over_network, over_udp
from koord.refinement.generating import palette
from koord.refinement.generating.palette import GENERAL, WILD, Profile
from koord.refinement.generating.programs import system as generated_system
from koord.refinement.judging import Judged, judge
from koord.refinement.running import Compiled, CompiledRun, ready, run
from koord.runtime.chaos.network import CALM, Faults
from koord.runtime.engine import AtRandom, Deployed, Schedule, Unheard
from koord.syntax import core
from koord.syntax.source import Source
from koord.syntax.system import System
from koord.syntax.types import BOOL
from koord.traces.replay import Refused
from koord.traces.trace import Sources

#: Seeds of the cases of one campaign are drawn from so many.
_SEEDS = 2**31

#: Values of generated programs: some double with every round.
_LARGEST = 120


class SchedulePolicy(Enum):
    """The kinds of schedules of a case."""

    DEPLOYED = "deployed"  #: rotating rank, first enabled event, no skips
    RANDOM = "random"  #: any order, any enabled event, now and then a skip

    def schedule(self, rng: Random) -> Schedule:
        return Deployed() if self is SchedulePolicy.DEPLOYED else AtRandom(rng)


class Target(Enum):
    """The ways to run a compiled program."""

    ENGINE = "engine"  #: all robots in one process, without messages
    KERNELS = "kernels"  #: the same, by machine code where it is sure of a turn
    NETWORK = "network"  #: deployed robots on a simulated network, in virtual time
    UDP = "udp"  #: deployed robots as processes that talk over UDP


class ProgramFamily(Enum):
    """The families of generated programs."""

    CALM = "calm"  #: little goes wrong
    GENERAL = "general"
    WILD = "wild"  #: longer bodies, in which more goes wrong

    @property
    def profile(self) -> Profile:
        return {
            ProgramFamily.CALM: palette.CALM,
            ProgramFamily.GENERAL: GENERAL,
            ProgramFamily.WILD: WILD,
        }[self]


class Case(Struct, frozen=True):
    """A test case: it determines the run, except for real processes."""

    system: System
    sources: Sources
    policy: SchedulePolicy
    rounds: int
    seed: int
    largest: int | None = None  #: the size of values at which the run ends
    target: Target = Target.ENGINE
    faults: Faults = CALM


class Tried(Struct, frozen=True):
    """The result of a case. ``crash`` is the traceback of a compiled program that raised."""

    case: Case
    judged: Judged | None = None
    ran: CompiledRun | None = None
    crash: str = ""

    @property
    def refused(self) -> Refused | None:
        return None if self.judged is None else self.judged.refused

    @property
    def failed(self) -> bool:
        """True if the run is not one of the semantics."""
        return bool(self.crash) or self.refused is not None


def tried(case: Case, of: Compiled | None = None) -> Tried:
    """Compile (unless that was done before), run, and judge a case."""
    try:
        ran = _run(case, of if of is not None else ready(case.system.program))
    except Exception:  # whatever a wrongly compiled program does is what is looked for
        return Tried(case, crash=traceback.format_exc(limit=-4))
    return Tried(case, judge(ran), ran)


def _run(case: Case, made: Compiled) -> CompiledRun:
    if case.target in (Target.ENGINE, Target.KERNELS):
        rng = Random(case.seed)
        schedule = case.policy.schedule(rng)
        if case.faults != CALM:
            schedule = Unheard(schedule, rng, case.faults.loss, case.faults.crashes_per_s > 0)
        kernels = case.target is Target.KERNELS
        given = (made, case.system, case.sources, schedule, case.rounds, rng, case.largest)
        return run(*given, kernels=kernels)
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
    """Yield cases of one program: systems in turn, every third as deployed."""
    for number, system in enumerate(systems):
        policy = SchedulePolicy.RANDOM if number % 3 else SchedulePolicy.DEPLOYED
        seed = seeds.randrange(_SEEDS)
        yield Case(system, sources, policy, rounds, seed, target=target, faults=faults)


def generated(
    seed: int, rounds: int, target: Target = Target.ENGINE, faults: Faults = CALM
) -> Case:
    """The case of a generated program, determined by the seed.

    Assumptions are left out: looking for a start that meets a random one would take most of the
    time. Properties say nothing to what runs; machine code looks at them as it does at turns.
    """
    rng = Random(seed)
    sort = rng.choice(
        (ProgramFamily.CALM, ProgramFamily.CALM, ProgramFamily.GENERAL, ProgramFamily.WILD)
    )
    system = generated_system(rng, sort.profile)
    properties = system.program.properties if target is Target.KERNELS else ()
    program = replace(system.program, assumptions=(), properties=properties)
    system = replace(system, program=program)
    policy = rng.choice((SchedulePolicy.RANDOM, SchedulePolicy.RANDOM, SchedulePolicy.DEPLOYED))
    sources = Sources(Source("generated", ""))
    return Case(system, sources, policy, rounds, seed, _LARGEST, target, faults)


def all_generated(
    seeds: Random, rounds: int, target: Target = Target.ENGINE, faults: Faults = CALM
) -> Iterator[Case]:
    """Yield generated cases without end."""
    while True:
        yield generated(seeds.randrange(_SEEDS), rounds, target, faults)


T = TypeVar("T")

#: So many smaller cases are tried.
TRIES = 400


def ever_smaller(
    failing: Tried, attempt: Callable[[Case], Tried], *, programs: bool, tries: int = TRIES
) -> Iterator[Tried]:
    """Yield failing cases, each smaller than the one before, by removing parts one at a time.

    With ``programs`` parts of the program are taken away, too: only where it is nobody's text.
    """
    best, left = failing, tries
    progress = True
    while progress and left > 0:
        progress = False
        for candidate in _smaller(best, programs=programs):
            left -= 1
            outcome = attempt(candidate)
            if outcome.failed:
                best, progress = outcome, True
                yield best
                break
            if left <= 0:
                break


def _smaller(tried: Tried, *, programs: bool) -> Iterator[Case]:
    case = tried.case
    refused = tried.refused
    if refused is not None and refused.step.round + 1 < case.rounds:
        yield replace(case, rounds=max(refused.step.round + 1, 0))
    if case.rounds > 0:
        yield replace(case, rounds=case.rounds // 2)
        yield replace(case, rounds=case.rounds - 1)
    kinds = case.system.kinds
    if len(kinds) > 1:
        for robot in range(len(kinds)):
            fewer = (*kinds[:robot], *kinds[robot + 1 :])
            yield replace(case, system=replace(case.system, kinds=fewer))
    if programs:
        for program in _smaller_programs(case.system.program):
            system = System(program, kinds, case.system.delta_s)
            yield replace(case, system=system)


def _smaller_programs(program: core.Program) -> Iterator[core.Program]:
    if program.properties:
        yield replace(program, properties=())
    for number in range(len(program.assumptions)):
        yield replace(program, assumptions=_without(program.assumptions, number))
    for kind, agent in enumerate(program.agents):
        for smaller in _smaller_agents(agent):
            agents = (*program.agents[:kind], smaller, *program.agents[kind + 1 :])
            yield replace(program, agents=agents)
    for number, function in enumerate(program.functions):
        for body in _smaller_blocks(function.body):
            if not body or not isinstance(body[-1], core.Return):
                continue  # no program has a function that may return nothing
            changed = replace(function, body=body)
            functions = (*program.functions[:number], changed, *program.functions[number + 1 :])
            yield replace(program, functions=functions)


def _smaller_agents(agent: core.Agent) -> Iterator[core.Agent]:
    for number, event in enumerate(agent.events):
        yield replace(agent, events=_without(agent.events, number))
        for smaller in _smaller_events(event):
            events = (*agent.events[:number], smaller, *agent.events[number + 1 :])
            yield replace(agent, events=events)
    for block in _smaller_blocks(agent.init):
        yield replace(agent, init=block)
    for number, module in enumerate(agent.modules):
        if module.environment:
            for block in _smaller_blocks(module.environment):
                changed = replace(module, environment=block)
                modules = (*agent.modules[:number], changed, *agent.modules[number + 1 :])
                yield replace(agent, modules=modules)


def _smaller_events(event: core.Event) -> Iterator[core.Event]:
    if event.urgent:
        yield replace(event, urgent=False)
    if not isinstance(event.guard, core.Const):
        yield replace(event, guard=core.Const(True, BOOL, span=event.guard.span))
    for block in _smaller_blocks(event.effect):
        yield replace(event, effect=block)


def _smaller_blocks(block: core.Block) -> Iterator[core.Block]:
    """Yield the block without one of its statements, or with a smaller one."""
    for number, statement in enumerate(block):
        before, after = block[:number], block[number + 1 :]
        yield (*before, *after)
        for smaller in _smaller_statements(statement):
            yield (*before, *smaller, *after)


def _smaller_statements(statement: core.Stmt) -> Iterator[core.Block]:
    match statement:
        case core.If(then=then, otherwise=otherwise):
            yield then
            yield otherwise
            for block in _smaller_blocks(then):
                yield (replace(statement, then=block),)
            for block in _smaller_blocks(otherwise):
                yield (replace(statement, otherwise=block),)
        case core.Atomic(body=body):
            yield body
            for block in _smaller_blocks(body):
                yield (replace(statement, body=block),)
        case core.ForRange(body=body):
            for block in _smaller_blocks(body):
                yield (replace(statement, body=block),)
        case core.ForEach(body=body):
            for block in _smaller_blocks(body):
                yield (replace(statement, body=block),)
        case _:
            return


def _without(items: tuple[T, ...], number: int) -> tuple[T, ...]:
    return (*items[:number], *items[number + 1 :])
