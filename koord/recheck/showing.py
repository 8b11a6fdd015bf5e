"""Configurations in the words of the program, for counterexamples."""

from __future__ import annotations

from collections.abc import Iterator

from koord.recheck.claims import Shown
from koord.recheck.storage import Cell, State, Storage
from koord.recheck.values import Values
from koord.recheck.world import World
from koord.syntax.types import EnumType, Type


def parts(world: World, v: Values, state: State, suffix: str = "") -> Iterator[Shown]:
    """The variables of a configuration, part by part."""
    program = world.program
    for d, storage in zip(program.allread, state.store.allread, strict=True):
        yield from _leaves(v, d.variable.name, suffix, storage, d.variable.type)
    for d, storage in zip(program.allwrite, state.store.allwrite, strict=True):
        yield from _leaves(v, d.variable.name, suffix, storage, d.variable.type)
    for i, robot in enumerate(state.robots):
        agent, where = world.agent(i), f"@{i}{suffix}"
        for d, storage in zip(agent.locals, robot.locals, strict=True):
            yield from _leaves(v, d.variable.name, where, storage, d.variable.type)
        for port, storage in zip(agent.ports, robot.ports, strict=True):
            its = port.declaration.variable
            yield from _leaves(v, port.label, where, storage, its.type)
        if world.stops():
            yield Shown(f"stopped@{i}{suffix}", robot.stopped, None)


def _leaves(v: Values, name: str, where: str, storage: Storage, type_: Type) -> Iterator[Shown]:
    if isinstance(storage, Cell):
        if storage.is_set.value is False:
            return
        for term, leaf in v.leaves(storage.value, type_):
            yield Shown(f"{name}{where}", term, leaf if isinstance(leaf, EnumType) else None)
        return
    parts = v.parts(type_)
    assert parts is not None
    assert isinstance(storage, tuple)
    for below, (label, part) in zip(storage, parts, strict=True):
        yield from _leaves(v, name + label, where, below, part)
