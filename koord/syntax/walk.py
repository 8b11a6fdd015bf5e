"""Everything that stands below a place in a core program, and what its statements write."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.types import BaseType

#: What was looked up, by class: a program has many nodes of few classes.
_BELOW: dict[type, tuple[str, ...] | None] = {}


def nodes(node: object) -> Iterator[object]:
    """A node (or a tuple of them), then everything below it, in the order of the text."""
    waiting = [node]
    while waiting:
        part = waiting.pop()
        if isinstance(part, tuple):
            waiting += reversed(part)
            continue
        names = _below(type(part))
        if names is not None:
            yield part
            waiting += [getattr(part, name) for name in reversed(names)]


def rebuilt(node: Any, part: Callable[[Any], Any]) -> Any:
    """A node (or a tuple of them) with something else in the place of each of its parts.

    What is no node stays as it is.
    """
    if isinstance(node, tuple):
        return tuple(part(each) for each in node)
    names = _below(type(node))
    if not names:
        return node
    return replace(node, **{name: part(getattr(node, name)) for name in names})


def last_site(program: core.Program) -> int:
    """The greatest number that a call or ``choose`` of the program has."""
    sites = [getattr(node, "site", 0) for node in nodes(program)]
    return max((site for site in sites if isinstance(site, int)), default=0)


def reached(program: core.Program, part: object) -> Iterator[object]:
    """The nodes of a part, and those of the functions that it calls, each function once."""
    bodies = {function.name: function.body for function in program.functions}
    pending = [part]
    while pending:
        for node in nodes(pending.pop()):
            yield node
            if isinstance(node, core.Call) and node.function in bodies:
                pending.append(bodies.pop(node.function))


def statements(block: core.Block) -> Iterator[core.Stmt]:
    """The statements of a block and of the blocks in it, each before those below it."""
    for s in block:
        yield s
        if isinstance(s, core.If):
            yield from statements(s.then)
            yield from statements(s.otherwise)
        elif isinstance(s, core.ForRange | core.ForEach | core.Atomic):
            yield from statements(s.body)


def written(statement: object) -> Iterator[core.Place]:
    """The places that a statement writes itself; none for those below it, nor for other nodes.

    A loop's own variables are not among them.
    """
    match statement:
        case core.Assign(place=place) | core.Append(place=place) | core.Remove(place=place):
            yield place
        case core.Pop(place=place, into=into):
            yield place
            if into is not None:
                yield into
        case _:
            pass


def _below(class_: type) -> tuple[str, ...] | None:
    """The fields of a node that hold parts of it; None for what is no node."""
    if class_ not in _BELOW:
        known = None
        if issubclass(class_, Struct) and not issubclass(class_, BaseType):
            known = tuple(name for name in class_.__struct_fields__ if name != "span")
        _BELOW[class_] = known
    return _BELOW[class_]


def asks(program: core.Program, part: core.Expr | core.Block) -> bool:
    """Whether a part of a program leaves something open."""
    open_ = core.ExternalCall | core.Choose
    return any(isinstance(node, open_) for node in reached(program, part))
