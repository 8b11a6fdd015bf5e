"""Lock classes: atomic blocks that write a common variable exclude each other. [ATOMIC]"""

from __future__ import annotations

from collections.abc import Iterable

from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.elaboration.body import AtomicBlock
from koord.syntax.walk import with_blocks


def lock_classes(
    blocks: Iterable[AtomicBlock],
) -> tuple[tuple[core.LockClass, ...], dict[int, int]]:
    """The classes, in order of their first block, and the class of each block."""
    ordered = sorted(blocks, key=lambda block: block.number)
    parent = {block.number: block.number for block in ordered}

    def root(number: int) -> int:
        while parent[number] != number:
            parent[number] = parent[parent[number]]
            number = parent[number]
        return number

    writer: dict[int, int] = {}
    for block in ordered:
        for slot in block.writes:
            one, other = sorted((root(writer.setdefault(slot, block.number)), root(block.number)))
            parent[other] = one
    roots = sorted({root(block.number) for block in ordered})
    index = {number: position for position, number in enumerate(roots)}
    class_of = {block.number: index[root(block.number)] for block in ordered}
    names: list[dict[int, str]] = [{} for _ in roots]
    for block in ordered:
        for slot, variable in block.writes.items():
            names[class_of[block.number]][slot] = variable.name
    classes = tuple(
        core.LockClass(position, tuple(known[slot] for slot in sorted(known)))
        for position, known in enumerate(names)
    )
    return classes, class_of


def classified(
    blocks: Iterable[AtomicBlock], agents: list[core.Agent]
) -> tuple[tuple[core.LockClass, ...], list[core.Agent]]:
    """The lock classes, and the agents with them in place of the numbers of atomic blocks."""
    classes, class_of = lock_classes(blocks)
    if not classes:
        return classes, agents
    return classes, [
        replace(agent, events=tuple(_event(event, class_of) for event in agent.events))
        for agent in agents
    ]


def _event(event: core.Event, class_of: dict[int, int]) -> core.Event:
    entered: set[int] = set()
    effect = relabelled(event.effect, class_of, entered)
    return replace(event, effect=effect, lock_classes=frozenset(entered)) if entered else event


def relabelled(block: core.Block, class_of: dict[int, int], entered: set[int]) -> core.Block:
    """The statements with lock classes in place of the numbers of blocks."""

    def inner(block: core.Block) -> core.Block:
        return tuple(with_blocks(relabel(s), inner) for s in block)

    def relabel(s: core.Stmt) -> core.Stmt:
        if not isinstance(s, core.Atomic):
            return s
        entered.add(class_of[s.lock_class])
        return replace(s, lock_class=class_of[s.lock_class])

    return inner(block)
