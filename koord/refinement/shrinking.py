"""A smaller case that fails as well: fewer rounds, fewer robots, less program."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

from msgspec.structs import replace

from koord.refinement.cases import Case, Tried
from koord.syntax import core
from koord.syntax.system import System
from koord.syntax.types import BOOL

T = TypeVar("T")

#: So many smaller cases are tried.
TRIES = 400


def ever_smaller(
    failing: Tried, attempt: Callable[[Case], Tried], *, programs: bool, tries: int = TRIES
) -> Iterator[Tried]:
    """Failing cases, each smaller than the one before, found by taking parts away one at a time.

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
    """The block without one of its statements, or with a smaller one."""
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
