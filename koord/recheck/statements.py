"""Statements of a body as guarded commands, loops over all robots included. [T-LOOP]

The body is worked out once, for a trip of whatever number, from a memory in which each scalar that
it changes is a variable. How the new value is written in terms of the old one says what all trips
make of it. What is written in no such way is not rechecked.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import assert_never

from msgspec import Struct, field
from msgspec.structs import replace

from koord.recheck import expressions, maps, places, sums
from koord.recheck.body import RunningBody
from koord.recheck.sorts import Family, NotRecheckedError, Value
from koord.recheck.storage import Cell, Frame, Many, Memory, Storage
from koord.recheck.sums import total
from koord.recheck.terms import BOOL, INT, Term
from koord.recheck.values import Values
from koord.recheck.world import Instance
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.source import Span
from koord.syntax.types import INT as INTEGER
from koord.syntax.types import MapType
from koord.syntax.walk import statements, written

#: What the body of such a loop may consist of.
_PLAIN = core.Assign | core.If | core.ForRange | core.ForEach | core.Break | core.Return


class LoopTerms(Struct):
    """A summary of a loop over ``[low, high)``; ``over``: its collection, its key's variable."""

    body: RunningBody
    low: Term
    high: Term
    variable: core.Variable
    over: tuple[Family, core.Variable | None] | None
    block: core.Block
    span: Span
    _blanks: list[Term] = field(default_factory=list)

    def run(self) -> None:
        """Apply the loop to the body's memory. [S-FOR] [S-FOREACH] [S-BREAK]"""
        body, t, v = self.body, self.body.t, self.body.v
        changed = self._changed()
        before = [places.storage_of(body, variable) for variable in changed]
        faults, legal = len(body.faults), len(body.legal)
        with v.within() as trip, body.among(trip, self.low, self.high):
            blank = [self._blank(storage) for storage in before]
            inside = self._inside(trip, self.high)
            after, left, broken, result = self._once(
                trip, inside, list(zip(changed, blank, strict=True))
            )
            exits = t.either(left, broken)
            with v.within() as lesser:
                on = t.implies(self._inside(lesser, trip), t.negation(t.put(exits, trip, lesser)))
                earlier = t.for_all([lesser], on)
        if exits.value is not False and (changed or self._mentions(exits)):
            raise self._refused("leaves early and changes variables")
        if left.value is not False and broken.value is not False:
            raise self._refused("both breaks and returns")
        self._keep(trip, earlier, faults, legal)
        for variable, old, was, new in zip(changed, before, blank, after, strict=True):
            made = self._summed_up(old, was, new, trip)
            places.set_storage(body, variable, body.s.merge(body.path, made, old, variable.type))
        if left.value is not False:
            self._return(trip, t.both(inside, left), earlier, result)

    def _refused(self, what: str) -> NotRecheckedError:
        return NotRecheckedError(f"a loop over all robots that {what} is not rechecked", self.span)

    def _inside(self, index: Term, end: Term) -> Term:
        return self.body.t.both(self.body.t.at_most(self.low, index), self.body.t.less(index, end))

    def _mentions(self, term: Term) -> bool:
        free = self.body.t.free(term)
        return any(blank.head in free for blank in self._blanks)

    # --- one trip -------------------------------------------------------------------------------

    def _changed(self) -> list[core.Variable]:
        found: dict[core.Variable, None] = {}
        for s in statements(self.block):
            if not isinstance(s, _PLAIN):
                raise self._refused("does more than assign variables")
            for place in written(s):
                if place.variable.home not in (Home.BOUND, Home.LOCAL):
                    raise self._refused("writes shared variables or ports")
                found[place.variable] = None
        inner = {s.variable for s in statements(self.block) if isinstance(s, core.ForRange)}
        return [variable for variable in found if variable not in inner]

    def _blank(self, storage: Storage) -> Storage:
        """Storage of the same shape with unknown scalars."""
        if isinstance(storage, Many) or (isinstance(storage, Cell) and not _is_plain(storage)):
            raise self._refused("changes more than scalars")
        if isinstance(storage, Cell):
            assert isinstance(storage.value, Term)
            self._blanks.append(self.body.t.blank(storage.value.sort))
            return Cell(storage.is_set, self._blanks[-1])
        return tuple(self._blank(part) for part in storage)

    def _once(
        self, trip: Term, inside: Term, memory: Sequence[tuple[core.Variable, Storage]]
    ) -> tuple[list[Storage], Term, Term, Storage | None]:
        """The variables after one trip, with the conditions of return and break, and the result."""
        body = self.body
        item: Value = trip
        if self.over is not None:
            family, key = self.over
            item = family.at(trip)
            if key is not None:
                body.bound[key.slot] = body.s.stored(trip, INTEGER)
        body.bound[self.variable.slot] = body.s.stored(item, self.variable.type)
        for variable, blank in memory:
            places.set_storage(body, variable, blank)
        left, broken, result = _tried(body, self.block, inside)
        return [places.storage_of(body, variable) for variable, _ in memory], left, broken, result

    def _keep(self, trip: Term, earlier: Term, faults: int, legal: int) -> None:
        """Generalise the faults and legality of one trip to all trips that happen."""
        body, t = self.body, self.body.t
        for position, fault in enumerate(body.faults[faults:], start=faults):
            if self._mentions(fault.when):
                raise self._refused("may fault for what earlier trips did")
            body.faults[position] = fault.of(t.exists([trip], t.both(fault.when, earlier)))
        # What is left out here only makes proofs harder.
        body.legal[legal:] = [
            t.for_all([trip], t.implies(earlier, fact))
            for fact in body.legal[legal:]
            if not self._mentions(fact)
        ]

    # --- all trips ------------------------------------------------------------------------------

    def _return(self, trip: Term, here: Term, earlier: Term, result: Storage | None) -> None:
        """Summarise returns: the first trip that returns counts. [T-LOOP]"""
        body, t = self.body, self.body.t
        returns = t.exists([trip], here)
        first = body.v.symbol("first trip", INT)
        body.legal.append(t.implies(returns, t.put(t.both(here, earlier), trip, first)))
        value = None if result is None else body.s.of(result, trip, first)
        _returns(body, t.both(body.path, returns), value)

    def _summed_up(self, old: Storage, was: Storage, new: Storage, trip: Term) -> Storage:
        if isinstance(old, Cell):
            assert isinstance(was, Cell)
            assert isinstance(new, Cell)
            if not (
                isinstance(old.value, Term)
                and isinstance(was.value, Term)
                and isinstance(new.value, Term)
                and new.is_set.value is True
            ):
                raise self._refused("changes more than scalars")
            return Cell(old.is_set, self._scalar(old.value, was.value, new.value, trip))
        assert isinstance(old, tuple)
        assert isinstance(was, tuple)
        assert isinstance(new, tuple)
        return tuple(self._summed_up(o, w, n, trip) for o, w, n in zip(old, was, new, strict=True))

    def _scalar(self, old: Term, was: Term, new: Term, trip: Term) -> Term:
        """The value of a scalar after all trips. [T-LOOP]"""
        t = self.body.t
        if new is was:
            return old
        inside = self._inside(trip, self.high)
        if was.sort == BOOL:
            stays, comes = t.put(new, was, t.truth(True)), t.put(new, was, t.truth(False))
            if comes.value is False and not self._mentions(stays):
                return t.both(old, t.for_all([trip], t.implies(inside, stays)))
            if stays.value is True and not self._mentions(comes):
                return t.either(old, t.exists([trip], t.both(inside, comes)))
            raise self._refused("changes a Boolean in a way that hangs on earlier trips")
        added = self._added(new, was)
        if added is not None and not self._mentions(added):
            return t.plus(old, total(self.body.v, self.low, self.high, trip, added))
        best = self._best(new, was)
        if best is not None:
            return self._extreme(old, trip, *best)
        raise self._refused("changes a number in a way that hangs on earlier trips")

    def _added(self, new: Term, was: Term) -> Term | None:
        """The addend that gives the new value from the old one, by the form of the term."""
        t = self.body.t
        if new is was:
            return t.minus(was, was)
        match new.head, new.args:
            case "+", [a, b]:
                for changed, other in ((a, b), (b, a)):
                    part = self._added(changed, was)
                    if part is not None and not self._mentions(other):
                        return t.plus(part, other)
            case "-", [a, b]:
                part = self._added(a, was)
                if part is not None and not self._mentions(b):
                    return t.minus(part, b)
            case "ite", [condition, a, b]:
                parts = self._added(a, was), self._added(b, was)
                if parts[0] is not None and parts[1] is not None and not self._mentions(condition):
                    return t.ite(condition, parts[0], parts[1])
        return None

    def _best(self, new: Term, was: Term) -> tuple[Term, Term, bool] | None:
        """Match a minimum or maximum: the condition, the value, and whether it is the lesser."""
        t = self.body.t
        if new.head != "ite":
            return None
        condition, a, b = new.args
        if a is was:
            condition, a, b = t.negation(condition), b, a
        if b is not was:
            return None
        if not self._mentions(condition):
            inner = self._best(a, was)
            return None if inner is None else (t.both(condition, inner[0]), inner[1], inner[2])
        if self._mentions(a):
            return None
        parts = condition.args if condition.head == "and" else (condition,)
        compared = [part for part in parts if self._mentions(part)]
        if len(compared) != 1:
            return None
        takes = t.conjunction(part for part in parts if part is not compared[0])
        for lesser in (True, False):
            pair = (a, was) if lesser else (was, a)
            if compared[0] in (
                t.less(*pair),
                t.at_most(*pair),
                t.negation(t.less(*pair[::-1])),
                t.negation(t.at_most(*pair[::-1])),
            ):
                return takes, a, lesser
        return None

    def _extreme(self, old: Term, trip: Term, takes: Term, value: Term, lesser: bool) -> Term:
        """The least (greatest) of the old value and of those that trips take."""
        t, body = self.body.t, self.body
        best = body.v.symbol("least" if lesser else "greatest", old.sort)

        def bounds(other: Term) -> Term:
            return t.at_most(best, other) if lesser else t.at_most(other, best)

        here = t.both(self._inside(trip, self.high), takes)
        reached = t.exists([trip], t.both(here, t.equal(best, value)))
        body.legal += [
            bounds(old),
            t.for_all([trip], t.implies(here, bounds(value))),
            t.either(t.equal(best, old), reached),
        ]
        return best


def _is_plain(cell: Cell) -> bool:
    return cell.is_set.value is True and isinstance(cell.value, Term)


def _tried(
    body: RunningBody, block: core.Block, condition: Term
) -> tuple[Term, Term, Storage | None]:
    """Run a block by itself under a condition.

    The results say when it returns, when it breaks out of the loop that it is the body of, and
    what it returns.
    """
    outer = (body.path, body.outside, body.frame, body.broke)
    body.outside = body.t.conjunction([body.outside, body.path, condition])
    body.path, never = body.t.truth(True), body.t.truth(False)
    frame = body.frame
    if frame is not None:
        assert frame.type is not None
        body.frame = Frame(body.s.unset(frame.type), frame.type, never)
    body.broke = [never]
    body.run(block)
    returned, result = never, None
    if body.frame is not None:
        returned, result = body.frame.returned, body.frame.result
    broken = body.broke[-1]
    body.path, body.outside, body.frame, body.broke = outer
    return returned, broken, result


def _returns(body: RunningBody, when: Term, result: Storage | None) -> None:
    """Record that the running function returns where a condition holds."""
    frame = body.frame
    assert frame is not None
    if result is not None:
        assert frame.type is not None
        frame.result = body.s.merge(when, result, frame.result, frame.type)
    frame.returned = body.t.either(frame.returned, when)


def body(world: Instance, values: Values, robot: Term | None, memory: Memory) -> RunningBody:
    """Make a body that a robot runs; None in a property."""
    return RunningBody(world, values, robot, memory, (expressions.value, run))


def run(body: RunningBody, block: core.Block) -> None:
    """Run statements in order; paths that left the block do not go on."""
    outer = body.path
    for s in block:
        execute(body, s)
        body.path = _going_on(body, outer)
        if body.path.value is False:
            break
    body.path = outer


def _going_on(body: RunningBody, outer: Term) -> Term:
    """The path of what neither broke out of the loop nor returned."""
    left = [*body.broke[-1:], *([body.frame.returned] if body.frame else [])]
    return body.t.both(outer, body.t.negation(body.t.disjunction(left)))


def execute(body: RunningBody, s: core.Stmt) -> None:
    t = body.t
    match s:
        case core.Assign():
            places.assign(body, s.place, body.value(s.value))
        case core.If():
            holds = body.condition(s.condition)
            for condition, block in ((holds, s.then), (t.negation(holds), s.otherwise)):
                if condition.value is not False:
                    with body.where(condition):
                        run(body, block)
        case core.ForRange() if is_open(body, s.low) or is_open(body, s.high):
            low, high = body.condition(s.low), body.condition(s.high)
            LoopTerms(body, low, high, s.variable, None, s.body, s.span).run()
        case core.ForRange():
            trips = [(None, t.integer(k)) for k in sums.fixed_range(body, s.low, s.high)]
            go_through(body, trips, None, s.variable, s.body)
        case core.ForEach():
            over = body.value(s.sequence)
            if isinstance(over, Family):
                zero = t.integer(0)
                LoopTerms(body, zero, body.v.count, s.value, (over, s.key), s.body, s.span).run()
                return
            if (target := _filled(s)) is not None:
                _take_over(body, target, over)
                return
            items = body.items(over, s.span)
            numbered = [(t.integer(k), item) for k, item in enumerate(items)]
            go_through(body, numbered, s.key, s.value, s.body)
        case core.Break():
            body.broke[-1] = t.either(body.broke[-1], body.path)
        case core.Return():
            assert body.frame is not None
            result = None
            if s.value is not None:
                assert body.frame.type is not None
                result = body.s.stored(body.value(s.value), body.frame.type)
            _returns(body, body.path, result)
        case core.Atomic():
            entered = body.entered.get(s.lock_class, t.truth(False))
            body.entered[s.lock_class] = t.either(entered, body.path)
            run(body, s.body)
        case core.Stop():
            body.stopped = t.either(body.stopped, body.path)
        case core.TryStop():
            body.asked = t.either(body.asked, body.path)
        case core.Output():
            for shown in s.values:
                body.value(shown)  # it may fault
        case core.Append():
            new = body.value(s.value)
            whole = places.read(body, s.place)
            places.assign(body, s.place, body.v.appended(whole, new, s.place.type))
        case core.Remove():
            places.removed(body, s)
        case core.Pop():
            places.popped(body, s)
        case _:
            assert_never(s)


def is_open(body: RunningBody, bound: core.Expr) -> bool:
    """Return whether a loop's bound is not constant, as the number of robots is open."""
    return body.v.robots is None and body.condition(bound).value is None


def _filled(loop: core.ForEach) -> core.Place | None:
    """The map that takes all entries of another over; None if a loop does anything else.

    That is ``for k, x in other: map[k] = x``, where the map is nobody else's.
    """
    match loop:
        case core.ForEach(
            key=key,
            value=value,
            sequence=sequence,
            body=(
                core.Assign(
                    place=core.Place(
                        variable=core.Variable(home=Home.BOUND | Home.LOCAL) as into,
                        steps=(
                            core.KeyStep(key=core.Read(place=core.Place(variable=at, steps=()))),
                        ),
                        robot=None,
                    ) as place,
                    value=core.Read(place=core.Place(variable=put, steps=())),
                ),
            ),
        ) if (at, put, into.type) == (key, value, sequence.type):
            return replace(place, steps=())
        case _:
            return None


def _take_over(body: RunningBody, target: core.Place, entries: Value) -> None:
    """Put all entries of a map into another, where they overwrite what is there. [S-FOREACH]

    No key comes twice, so their order tells nothing.
    """
    type_, old = target.variable.type, places.read(body, target)
    assert isinstance(type_, MapType)
    assert isinstance(old, Term)
    assert isinstance(entries, Term)
    places.assign(body, target, maps.overwritten(body.v, old, entries, type_))


def go_through(
    body: RunningBody,
    trips: Sequence[tuple[Term | None, Value]],
    key: core.Variable | None,
    variable: core.Variable,
    block: core.Block,
) -> None:
    """Run the trips one after the other, until one breaks. [S-FOR] [S-FOREACH] [S-BREAK]"""
    body.broke.append(body.t.truth(False))
    outer = body.path
    for number, value in trips:
        body.path = _going_on(body, outer)
        if body.path.value is False:
            break
        if key is not None and number is not None:
            body.bound[key.slot] = body.s.stored(number, INTEGER)
        body.bound[variable.slot] = body.s.stored(value, variable.type)
        run(body, block)
    body.broke.pop()
    body.path = outer
