"""Operations on values as terms."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from functools import reduce

from msgspec import Struct, field

from koord.recheck import maps
from koord.recheck.sorts import Family, Sorts, Value
from koord.recheck.terms import BOOL, INT, Term, quoted
from koord.syntax.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    GrowingType,
    MapType,
    RecordType,
    Type,
)


class Sum(Struct, frozen=True):
    """A term for a sum: ``total`` is the sum of ``part`` over ``index`` in ``[low, high)``.

    Both may depend on numbers of robots, ``names``: then it is one for any.
    """

    total: Term
    low: Term
    high: Term
    index: Term
    part: Term
    names: tuple[Term, ...] = ()


#: The function that tells places of what goes round a ring more than once.
FAR = "place of what goes round often"


class Values(Sorts):
    """A builder of values, with the axioms of its fresh symbols."""

    #: What every unknown satisfies by its type.
    ranges: list[Term] = field(default_factory=list)
    _strings: dict[str, int] = field(default_factory=dict)
    _names: dict[str, int] = field(default_factory=dict)
    #: The variables of quantifiers around what is worked out: all that is new depends on them.
    scope: tuple[Term, ...] = ()
    #: External functions whose summaries are supposed of all questions.
    promised: set[str] = field(default_factory=set)
    #: Functions of numbers of robots.
    indexed: set[str] = field(default_factory=set)
    #: Sums over all robots that were met so far.
    sums: list[Sum] = field(default_factory=list)

    @property
    def count(self) -> Term:
        """The number of robots."""
        if self.robots is not None:
            return self.t.integer(self.robots)
        if "N" not in self._names:
            with self.scoped(()):
                self.ranges.append(self.t.at_most(self.t.integer(1), self.symbol("N", INT)))
        return self.t.symbol("N", INT)

    def around(self, number: Term) -> Term:
        """What is left of a number divided by how many robots there are: a place in a ring.

        What goes round once is no product of unknowns, on which solvers work as long as luck wants.
        Of what goes round more often it is known that it is the number of a robot, and no more.
        """
        t, count = self.t, self.count
        if count.value is not None:
            return t.remainder(number, count)
        if FAR not in self._names:
            self._names[FAR] = 1
            self.declarations.append(f"(declare-fun {quoted(FAR)} ({INT}) {INT})")
        far = t.op(quoted(FAR), (number,), INT)
        place = t.ite(self.is_robot(far), far, t.integer(0))
        for low, high, turned in (
            (t.negative(count), t.integer(0), t.plus(number, count)),
            (count, t.plus(count, count), t.minus(number, count)),
            (t.integer(0), count, number),
        ):
            place = t.ite(t.both(t.at_most(low, number), t.less(number, high)), turned, place)
        return place

    @contextmanager
    def scoped(self, scope: tuple[Term, ...]) -> Iterator[None]:
        """Within the context, fresh symbols are functions of some variables."""
        outer, self.scope = self.scope, scope
        try:
            yield
        finally:
            self.scope = outer

    @contextmanager
    def within(self, sort: str = INT) -> Iterator[Term]:
        """Within the context, a fresh bound variable of a quantifier."""
        variable = self.t.bound(len(self.scope), sort)
        while variable in self.scope:
            variable = self.t.blank(sort)
        with self.scoped((*self.scope, variable)):
            yield variable

    # --- making ---------------------------------------------------------------------------------

    def text(self, text: str) -> Term:
        """Encode a string as a number: strings are only compared for equality."""
        return self.t.integer(self._strings.setdefault(text, len(self._strings)))

    def default(self, type_: Type) -> Value:
        """Some value, to continue with after a fault."""
        if isinstance(type_, ArrayType) and self.is_family(type_):
            element = self.default(type_.element)
            return Family(lambda index: element)
        parts = self.parts(type_)
        if parts is not None:
            return tuple(self.default(part) for _, part in parts)
        match type_:
            case GrowingType():
                return ()
            case BoolType():
                return self.t.truth(False)
            case FloatType():
                return self.t.real(Fraction(0))
            case MapType():
                return maps.empty(self, type_)
            case _:
                self.sort(type_)
                return self.t.integer(0)

    def symbol(self, name: str, sort: str) -> Term:
        """A fresh constant; inside a quantifier a function. Repeated names are numbered."""
        count = self._names[name] = self._names.get(name, 0) + 1
        full = name if count == 1 else f"{name} ({count})"
        if self.scope:
            sorts = " ".join(variable.sort for variable in self.scope)
            self.declarations.append(f"(declare-fun {quoted(full)} ({sorts}) {sort})")
            self.indexed.add(quoted(full))
            return self.t.op(quoted(full), self.scope, sort)
        self.declarations.append(f"(declare-const {quoted(full)} {sort})")
        return self.t.symbol(full, sort)

    def fresh(self, name: str, type_: Type, length: int | None = None) -> Value:
        """A fresh value of a type; ``length`` is that of a list, if it is known."""
        if isinstance(type_, ArrayType) and self.is_family(type_):
            return self.family(lambda index: self.fresh(f"{name}[]", type_.element, length))
        parts = self.parts(type_)
        if parts is not None:
            return tuple(self.fresh(name + label, part) for label, part in parts)
        if length is not None and isinstance(type_, GrowingType):
            return tuple(self.fresh(f"{name}[{k}]", type_.element) for k in range(length))
        made = self.symbol(name, self.sort(type_))
        self.ranges += [self.t.for_all(self.scope, b) for b in self.bounds(made, type_)]
        return made

    def family(self, element: Callable[[Term], Value]) -> Family:
        """A family from one element, computed for a variable number."""
        with self.scoped((*self.scope, blank := self.t.blank())):
            one = element(blank)
        return Family(lambda index: self.put(one, blank, index))

    def put(self, value: Value, old: Term, new: Term) -> Value:
        """Substitute a term for a variable in a value."""
        if isinstance(value, Term):
            return self.t.put(value, old, new)
        if isinstance(value, Family):
            return Family(lambda index: self.put(value.at(index), old, new))
        return tuple(self.put(part, old, new) for part in value)

    def bounds(self, term: Term, type_: Type) -> list[Term]:
        """The facts that hold of any term of a type."""
        if isinstance(type_, MapType):
            return [maps.bounds(self, term, type_)]
        if not isinstance(type_, EnumType):
            return []
        t = self.t
        last = t.integer(len(type_.members) - 1)
        return [t.at_most(t.integer(0), term), t.at_most(term, last)]

    def applied(self, name: str, arguments: list[Term], type_: Type) -> Value:
        """An application of an uninterpreted function, one symbol per scalar of the answer."""
        parts = self.parts(type_)
        if parts is not None:
            return tuple(self.applied(name + label, arguments, part) for label, part in parts)
        return self.function(name, arguments, self.sort(type_))

    def merge(self, condition: Term, a: Value, b: Value, type_: Type) -> Value:
        """If-then-else: ``a`` where the condition holds, else ``b``."""
        if condition.value is not None:
            return a if condition.value else b
        if a is b:
            return a
        if isinstance(a, Family) and isinstance(b, Family):
            element = self.element(type_)
            return Family(lambda index: self.merge(condition, a.at(index), b.at(index), element))
        types = self._types_below(a, b, type_)
        if types is None:
            return self.t.ite(condition, self.pack(a, type_), self.pack(b, type_))
        assert isinstance(a, tuple)
        assert isinstance(b, tuple)
        return tuple(
            self.merge(condition, x, y, part) for x, y, part in zip(a, b, types, strict=True)
        )

    def equal(self, a: Value, b: Value, type_: Type) -> Term:
        if a is b:
            return self.t.truth(True)
        if isinstance(a, Family) and isinstance(b, Family):
            element = self.element(type_)
            return self.every(lambda index: self.equal(a.at(index), b.at(index), element))
        types = self._types_below(a, b, type_)
        if types is None:
            if isinstance(a, tuple) and isinstance(b, tuple):
                return self.t.truth(False)  # lists of known and different lengths
            return self.t.equal(self.pack(a, type_), self.pack(b, type_))
        assert isinstance(a, tuple)
        assert isinstance(b, tuple)
        same = [self.equal(x, y, part) for x, y, part in zip(a, b, types, strict=True)]
        return self.t.conjunction(same)

    def _types_below(self, a: Value, b: Value, type_: Type) -> list[Type] | None:
        """The types of the parts of two trees of one shape, or None."""
        if not (isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b)):
            return None
        if isinstance(type_, RecordType):
            return [part for _, part in type_.fields]
        return [self.element(type_)] * len(a)

    # --- lists and arrays -----------------------------------------------------------------------

    def every(self, holds: Callable[[Term], Term]) -> Term:
        """The condition that a Boolean holds of all robots, by their numbers."""
        with self.within() as index:
            return self.t.for_all([index], self.t.implies(self.is_robot(index), holds(index)))

    def is_robot(self, index: Term) -> Term:
        return self.t.both(self.t.at_most(self.t.integer(0), index), self.t.less(index, self.count))

    def kind(self, index: Term, kinds: int) -> Term:
        """The kind of a robot, where the number of robots is open."""
        if "|kind()|" not in self._functions:
            with self.within() as robot:
                its = self.function("kind", [robot], INT)
                bounds = self.t.both(
                    self.t.at_most(self.t.integer(0), its), self.t.less(its, self.t.integer(kinds))
                )
                self.ranges.append(self.t.for_all([robot], bounds))
        return self.function("kind", [index], INT)

    def length(self, value: Value, type_: Type | None = None) -> Term:
        """The number of elements or keys; maps need their type."""
        if isinstance(type_, MapType):
            assert isinstance(value, Term)
            return maps.count(self, value, type_)
        if isinstance(value, Family):
            return self.count
        if isinstance(value, tuple):
            return self.t.integer(len(value))
        return self.t.op("seq.len", [value], INT)

    def inside(self, value: Value, index: Term) -> Term:
        """The condition that an index is in range."""
        t = self.t
        return t.both(t.at_most(t.integer(0), index), t.less(index, self.length(value)))

    def at(self, value: Value, index: Term, type_: Type) -> Value:
        """An element of a list or array; any value if it does not exist."""
        element = self.element(type_)
        if isinstance(value, Family):
            return value.at(index)
        if isinstance(value, Term):
            found = self.t.op("seq.nth", [value, index], self.sort(element))
            return self.unpack(found, element)
        if index.value is not None:
            k = int(index.value)
            return value[k] if 0 <= k < len(value) else self.default(element)
        if not value:
            return self.default(element)
        found_value = value[-1]
        for k in range(len(value) - 2, -1, -1):
            here = self.t.equal(index, self.t.integer(k))
            found_value = self.merge(here, value[k], found_value, element)
        return found_value

    def with_element(self, value: Value, index: Term, new: Value, type_: Type) -> Value:
        """The list with one element replaced; unchanged if it does not exist."""
        element = self.element(type_)
        if isinstance(value, Term):
            sort = value.sort
            unit = self.t.op("seq.unit", [self.pack(new, element)], sort)
            return self.t.op("seq.update", [value, index, unit], sort)
        if isinstance(value, Family):
            return Family(lambda k: self.merge(self.t.equal(index, k), new, value.at(k), element))
        return tuple(
            self.merge(self.t.equal(index, self.t.integer(k)), new, old, element)
            for k, old in enumerate(value)
        )

    def contains(self, value: Value, wanted: Value, type_: Type) -> Term:
        if isinstance(type_, MapType):
            assert isinstance(value, Term)
            return maps.has(self, value, wanted, type_)
        element = self.element(type_)
        if isinstance(value, Term):
            unit = self.t.op("seq.unit", [self.pack(wanted, element)], value.sort)
            return self.t.op("seq.contains", [value, unit], BOOL)
        if isinstance(value, Family):
            return self.t.negation(
                self.every(lambda k: self.t.negation(self.equal(value.at(k), wanted, element)))
            )
        return self.t.disjunction(self.equal(item, wanted, element) for item in value)

    def appended(self, value: Value, new: Value, type_: Type) -> Value:
        if isinstance(value, tuple):
            return (*value, new)
        whole, tail = self.pack(value, type_), self.pack((new,), type_)
        return self.t.op("seq.++", [whole, tail], whole.sort)

    def without(self, value: Value, position: Term, type_: Type) -> Value:
        """The list without one element that exists."""
        t, whole = self.t, self.pack(value, type_)
        zero, one = t.integer(0), t.integer(1)
        length = self.length(whole)
        after = t.plus(position, one)
        head = t.op("seq.extract", [whole, zero, position], whole.sort)
        tail = t.op("seq.extract", [whole, after, t.minus(length, after)], whole.sort)
        return t.op("seq.++", [head, tail], whole.sort)

    def position(self, value: Value, wanted: Value, type_: Type) -> Term:
        """The index of the first equal element; negative if there is none."""
        whole = self.pack(value, type_)
        unit = self.pack((wanted,), type_)
        return self.t.op("seq.indexof", [whole, unit, self.t.integer(0)], INT)

    def least(self, items: tuple[Value, ...], *, greatest: bool) -> Term:
        """The minimum or maximum, by folding from the left."""

        def better(best: Term, item: Term) -> Term:
            pair = (best, item) if greatest else (item, best)
            return self.t.ite(self.t.less(*pair), item, best)

        return reduce(better, [item for item in items if isinstance(item, Term)])
