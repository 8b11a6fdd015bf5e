"""Loops whose outcome does not depend on the order of their trips. [SYMMETRY]

Of the three forms below, the first two have the same outcome in every order, faults included, since
every trip is made and none sees what another one wrote. In the third the loop ends early, so its
conditions must not fault; then all that matters is whether *some* trip takes the way out.

- a trip sets a variable to something that is the same on every trip, or writes the one element of
  an array that its own loop variable names;
- a trip adds to a variable (``v = v + e``, ``max``, ``or``, …) what does not depend on it;
- ``if c: block`` where the block does the same on every trip and then leaves the loop.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from koord.syntax import core
from koord.syntax.analysis.definedness import Sure
from koord.syntax.core import BinaryOp, Home
from koord.syntax.walk import nodes, statements, written

_GATHERING = (
    BinaryOp.ADD,
    BinaryOp.MUL,
    BinaryOp.MIN,
    BinaryOp.MAX,
    BinaryOp.AND,
    BinaryOp.OR,
)


def is_order_free(body: core.Block, loop: frozenset[core.Variable], sure: Sure) -> bool:
    """Whether trips may be made in any order. ``loop`` are the loop's own variables."""
    leaving = [s for s in statements(body) if isinstance(s, core.Break | core.Return)]
    changed = {variable for s in statements(body) for variable in _changed(s)}
    if leaving:
        return _leaves_once(body, _Loop(loop, frozenset(changed), sure))
    return _gathers(body, _Loop(loop, frozenset(changed), sure))


class _Loop(Struct, frozen=True):
    variables: frozenset[core.Variable]
    changed: frozenset[core.Variable]
    sure: Sure

    def sees_no_trip(self, e: object) -> bool:
        """Whether an expression reads nothing that a trip writes."""
        if any(isinstance(node, core.Call) for node in nodes(e)):
            # A function may read whatever is not bound to a body of its own.
            return all(v.home is Home.BOUND for v in self.changed) and self._unchanged(e)
        return self._unchanged(e)

    def _unchanged(self, e: object) -> bool:
        return not any(v in self.changed for v in _read(e))

    def is_same(self, e: object) -> bool:
        """Whether an expression is the same on every trip."""
        return self.sees_no_trip(e) and not any(v in self.variables for v in _read(e))


# --- loops that go to the end ---------------------------------------------------------------------


def _gathers(body: core.Block, loop: _Loop) -> bool:
    assigned: dict[core.Variable, list[core.Assign]] = {}
    for s in statements(body):
        match s:
            case core.Assign():
                assigned.setdefault(s.place.variable, []).append(s)
            case core.If(condition=condition):
                if not loop.sees_no_trip(condition):
                    return False
            case _:
                return False
    return all(_agree(writes, loop) for writes in assigned.values())


def _agree(writes: list[core.Assign], loop: _Loop) -> bool:
    """Whether the writes to one variable end the same in any order of trips."""
    first = writes[0]
    if all(loop.is_same(w.place.steps) and loop.is_same(w.value) for w in writes):
        return all(w.place == first.place and w.value == first.value for w in writes)
    if all(_is_own_element(w.place, loop) and loop.sees_no_trip(w.value) for w in writes):
        return True
    ops = {_gathered(w, loop) for w in writes}
    return len(ops) == 1 and None not in ops and all(w.place == first.place for w in writes)


def _is_own_element(place: core.Place, loop: _Loop) -> bool:
    """``x[i]`` or a part of it, where i is the loop's variable."""
    match place.steps:
        case (core.IndexStep(index=core.Read(place=core.Place(variable=v, steps=()))), *rest):
            return v in loop.variables and loop.sees_no_trip(tuple(rest))
        case _:
            return False


def _gathered(write: core.Assign, loop: _Loop) -> BinaryOp | None:
    """The operator of ``v = v op e``, if what is added does not depend on other trips."""
    match write.value:
        case core.Binary(op=op, left=core.Read(place=place), right=e) if op in _GATHERING:
            fits = place == write.place and loop.is_same(place.steps) and loop.sees_no_trip(e)
            # ``and`` and ``or`` do not look at what cannot matter any more.
            short = op in (BinaryOp.AND, BinaryOp.OR)
            return op if fits and (not short or loop.sure.of(e)) else None
        case _:
            return None


# --- loops that end early -------------------------------------------------------------------------


def _leaves_once(body: core.Block, loop: _Loop) -> bool:
    ways = list(_leaves(body, loop))
    first = next((way for way in ways if way), None)
    return first is not None and all(way in ((), first) for way in ways) and _is_way(first, loop)


def _leaves(block: core.Block, loop: _Loop) -> Iterator[core.Block | None]:
    """The ends of a tree of conditions; None where a condition may fault or see another trip."""
    match block:
        case ():
            yield ()
        case (core.If(condition=condition, then=then, otherwise=otherwise),):
            if not (loop.sees_no_trip(condition) and loop.sure.of(condition)):
                yield None
            yield from _leaves(then, loop)
            yield from _leaves(otherwise, loop)
        case _:
            yield block


def _is_way(block: core.Block, loop: _Loop) -> bool:
    """Whether a block does the same on every trip, and then leaves."""
    *before, last = block
    if not all(
        isinstance(s, core.Assign) and loop.is_same(s.place.steps) and loop.is_same(s.value)
        for s in before
    ):
        return False
    match last:
        case core.Break():
            return True
        case core.Return(value=value):
            return loop.is_same(value)
        case _:
            return False


# --- the text -------------------------------------------------------------------------------------


def _changed(s: core.Stmt) -> Iterator[core.Variable]:
    """What a trip through a statement leaves changed, the variables of inner loops included."""
    match s:
        case core.ForRange(variable=variable):
            yield variable
        case core.ForEach(key=key, value=value):
            yield from (v for v in (key, value) if v is not None)
        case _:
            yield from (place.variable for place in written(s))


def _read(e: object) -> Iterator[core.Variable]:
    return (node.variable for node in nodes(e) if isinstance(node, core.Place))
