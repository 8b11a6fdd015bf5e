"""Traversal of core programs: nodes, blocks, operands, and the writes of statements."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from operator import attrgetter
from typing import Any, get_args

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.types import BaseType

#: What stands in a statement and is not evaluated by it.
_NO_OPERANDS = (core.Variable, *get_args(core.Stmt))

_CALLS = (core.Call, core.ExternalCall)


class _Below(dict[type, tuple[str, ...] | None]):
    """A cache: per class of nodes the fields that may hold parts; None for other classes."""

    def __missing__(self, class_: type) -> tuple[str, ...] | None:
        found = None
        if issubclass(class_, Struct) and not issubclass(class_, BaseType):
            found = tuple(name for name in class_.__struct_fields__ if name != "span")
        self[class_] = found
        return found


class _Parts(dict[type, Callable[[Any], tuple[Any, ...]] | None]):
    """A cache: per class of nodes what gives all their parts, the last one first."""

    def __missing__(self, class_: type) -> Callable[[Any], tuple[Any, ...]] | None:
        names = _BELOW[class_]
        found: Callable[[Any], tuple[Any, ...]] | None = None
        if issubclass(class_, tuple):
            found = _reversed
        elif names is not None:
            found = _getting(names[::-1])
        self[class_] = found
        return found


def _getting(names: tuple[str, ...]) -> Callable[[Any], tuple[Any, ...]]:
    """What gives the fields of some names; of one name ``attrgetter`` would give no tuple."""
    if len(names) > 1:
        return attrgetter(*names)
    return lambda node: tuple(getattr(node, name) for name in names)


def _reversed(parts: tuple[Any, ...]) -> tuple[Any, ...]:
    return parts[::-1]


class _Blocks(dict[type, tuple[str, ...]]):
    """A cache: per class of statements the fields that hold blocks."""

    def __missing__(self, class_: type) -> tuple[str, ...]:
        names = ("then", "otherwise", "body")
        self[class_] = found = tuple(name for name in names if hasattr(class_, name))
        return found


_BELOW, _PARTS, _BLOCKS = _Below(), _Parts(), _Blocks()


def nodes(node: object) -> Iterator[object]:
    """A node (or a tuple of them), then everything below it, in the order of the text."""
    waiting = [node]
    while waiting:
        part = waiting.pop()
        parts = _PARTS[type(part)]
        if parts is not None:
            if parts is not _reversed:
                yield part
            waiting += parts(part)


def children(node: object) -> Iterator[Any]:
    """The nodes directly below a node (or a tuple of them), in the order of the text."""
    parts = _PARTS[type(node)]
    waiting: list[Any] = [] if parts is None else list(parts(node))
    while waiting:
        part = waiting.pop()
        if isinstance(part, tuple):
            waiting += reversed(part)
        elif _BELOW[type(part)] is not None:
            yield part


def rebuilt(node: Any, part: Callable[[Any], Any]) -> Any:
    """Rebuild a node (or a tuple of them) with a function applied to each of its parts.

    What is no node stays as it is.
    """
    if isinstance(node, tuple):
        return tuple(part(each) for each in node)
    names = _BELOW[type(node)]
    if not names:
        return node
    return replace(node, **{name: part(getattr(node, name)) for name in names})


def renamed(node: Any, old: core.Variable, new: core.Variable) -> Any:
    """A node in which one variable is another, whose slot no other variable of it has."""
    if isinstance(node, core.Variable):
        return new if node == old else node
    return rebuilt(node, lambda part: renamed(part, old, new))


def last_site(program: core.Program) -> int:
    """The greatest number that a call or ``choose`` of the program has."""
    sites = [getattr(node, "site", 0) for node in nodes(program)]
    return max((site for site in sites if isinstance(site, int)), default=0)


def reached(program: core.Program, part: object, *, duties: bool = False) -> Iterator[object]:
    """The nodes of a part, and those of the functions that it calls, each function once.

    With ``duties`` also what the external functions that it calls require of their callers.
    """
    bodies: dict[str, object] = {function.name: function.body for function in program.functions}
    if duties:
        bodies |= {external.name: external.requires for external in program.externals}
    pending = [part]
    while pending:
        for node in nodes(pending.pop()):
            yield node
            if isinstance(node, _CALLS) and node.function in bodies:
                pending.append(bodies.pop(node.function))


def chained(e: core.Expr, op: core.BinaryOp) -> Iterator[core.Expr]:
    """The operands of a chain of one operator, in the order in which they are looked at."""
    if isinstance(e, core.Binary) and e.op is op:
        yield from chained(e.left, op)
        yield from chained(e.right, op)
    else:
        yield e


def blocks(s: core.Stmt) -> tuple[core.Block, ...]:
    """The blocks directly in a statement; all other parts of it are :func:`operands`."""
    return tuple(getattr(s, name) for name in _BLOCKS[type(s)])


def with_blocks(s: core.Stmt, of: Callable[[core.Block], core.Block]) -> core.Stmt:
    """Rebuild a statement with a function applied to each block directly in it."""
    made = {name: of(getattr(s, name)) for name in _BLOCKS[type(s)]}
    return replace(s, **made) if made else s


def operands(s: core.Stmt) -> Iterator[core.Expr | core.Place]:
    """The expressions and places that a statement evaluates itself, in the order of the text.

    Those of the blocks in it are not among them, nor are a loop's own variables.
    """
    for part in children(s):
        if not isinstance(part, _NO_OPERANDS):
            yield part


def statements(block: core.Block, *, atomic: bool = True) -> Iterator[core.Stmt]:
    """The statements of a block and of the blocks in it, each before those below it.

    Those in ``atomic`` blocks are left out if it is False.
    """
    for s in block:
        yield s
        if atomic or not isinstance(s, core.Atomic):
            for inner in blocks(s):
                yield from statements(inner, atomic=atomic)


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


def asks(program: core.Program, part: core.Expr | core.Block) -> bool:
    """Return whether a part of a program asks for answers: external calls or ``choose``."""
    open_ = core.ExternalCall | core.Choose
    return any(isinstance(node, open_) for node in reached(program, part))
