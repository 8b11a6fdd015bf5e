"""The language of lemmas of a program: the parts of its variables, and all literals of them."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from functools import partial
from itertools import permutations
from typing import TypeAlias, TypeVar, assert_never

from msgspec import Struct

from koord.semantics.configurations import Configuration, Robot, Store
from koord.semantics.domain import Constant
from koord.semantics.storage import Cell, Storage, Tree
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home
from koord.syntax.types import Type
from koord.verify.engines.every_n.comparisons import (
    asks_everybody,
    existences,
    is_about_numbers,
    is_ring,
    literals_of,
    quantities_of,
    quantities_of_two,
)
from koord.verify.engines.every_n.conditions import UNSET, Asked, Condition, conditions_of
from koord.verify.engines.every_n.literals import (
    OF_H,
    OF_I,
    OF_J,
    PLACES,
    AnyLiteral,
    Between,
    ConditionLiteral,
    Existence,
    Literal,
    Quantity,
    Row,
    Snapshot,
    twin_of,
)
from koord.verify.engines.every_n.parts import (
    SHARED,
    Part,
    element_of,
    mutual_parts,
    parts_of,
)

#: More literals are not looked at: disjunctions of three of them would be too many.
_MOST_LITERALS = 160

V = TypeVar("V")

#: What a robot has, by home and slot: of what is an array over robots, its element.
Held: TypeAlias = "Mapping[Home, Mapping[int, Storage[V]]]"

#: By literal: which one it is where robots have changed places, None if there is none.
Renaming: TypeAlias = "tuple[int | None, ...]"

#: Who is whom where i and j change places, and in all other ways of three.
_PLACES = ({OF_I: OF_J, OF_J: OF_I, OF_H: OF_H},)
_RING_PLACES = (
    *_PLACES,
    {OF_I: OF_J, OF_J: OF_H, OF_H: OF_I},
    {OF_I: OF_H, OF_J: OF_I, OF_H: OF_J},
    {OF_I: OF_H, OF_J: OF_J, OF_H: OF_I},
    {OF_I: OF_I, OF_J: OF_H, OF_H: OF_J},
)


class Language(Struct, frozen=True):
    """The parts and literals of a program with one kind of robots.

    ``mutual`` are parts that each robot has of each. Where robots stand in a ``ring``, the last
    literals are those about a third robot.
    """

    own: tuple[Part, ...]
    mutual: tuple[Part, ...]
    shared: tuple[Part, ...]
    literals: tuple[AnyLiteral, ...]
    conditions: tuple[Condition, ...]
    renamed: tuple[Renaming, ...]  #: what becomes of literals where robots change places
    size: int  #: of the arrays that k is an index of; 1 if there is no k
    ring: bool

    @staticmethod
    def of_program(program: core.Program, *, somebody: bool = False) -> Language:
        """Make the language; ``somebody``: it has that there is a robot in a state in any case."""
        agent = program.agents[0]
        declared = (*agent.locals, *(port.declaration for port in agent.ports))
        own = [p for d in declared for p in parts_of(d.variable, (), d.variable.type)]
        mutual = [p for d in declared for p in mutual_parts(d.variable, d.variable.type)]
        shared: list[Part] = []
        for d in (*program.allread, *program.allwrite):
            element = element_of(d.variable)
            if element is not None:
                own += parts_of(d.variable, (), element)
                mutual += mutual_parts(d.variable, element)
            else:
                shared += parts_of(d.variable, (), d.variable.type)
        sizes = [part.size for part in (*own, *shared) if part.size is not None]
        size = max(sizes, key=sizes.count, default=1)
        own = [part for part in own if part.size in (None, size)]
        shared = [part for part in shared if part.size in (None, size)]
        k, ring = size if sizes else None, is_ring(program)
        literals: list[AnyLiteral] = [
            *literals_of(program, quantities_of_two(own, mutual, shared), k)[:_MOST_LITERALS]
        ]
        simple = list(literals)
        conditions = conditions_of(program, size)
        for position, each in enumerate(conditions):
            # Of i, then of j.
            for of in (OF_I, OF_J) if each.of else (0,):
                literals += [
                    ConditionLiteral(each, position, of, positive) for positive in (True, False)
                ]
        if somebody or asks_everybody(program):
            asked = simple if asks_everybody(program) else [x for x in simple if x.cost == 1]
            literals += existences(asked)[: max(0, _MOST_LITERALS - len(literals))]
        if ring:
            third = [*quantities_of(OF_H, own), *quantities_of_two(own, (), shared)]
            found = [x for x in literals_of(program, third, k) if x.of & OF_H]
            literals += [Between(positive) for positive in (True, False)]
            literals += [x for x in found if not is_about_numbers(x)][:_MOST_LITERALS]
        return Language(
            tuple(own),
            tuple(mutual),
            tuple(shared),
            tuple(literals),
            tuple(conditions),
            tuple(_renamed(literals, places) for places in (_RING_PLACES if ring else _PLACES)),
            size,
            ring,
        )

    def snapshot(
        self,
        robots: Mapping[int, Held[V]],
        shared: Sequence[Storage[V]],
        element: Callable[[Storage[V], int], Storage[V]],
        read: Callable[[Cell[V], Type], object],
        count: int,
        asked: Asked,
    ) -> Snapshot:
        """The values of a configuration; ``element`` takes a robot's of an array over robots."""
        known = {
            number: tuple(
                _value(held[part.variable.home][part.variable.slot], part, read)
                for part in self.own
            )
            for number, held in robots.items()
        }
        pairs = {
            (owner, other): tuple(
                _value(element(held[p.variable.home][p.variable.slot], other), p, read)
                for p in self.mutual
            )
            for owner, held in (robots.items() if self.mutual else ())
            for other in robots
        }
        common = tuple(_value(shared[part.variable.slot], part, read) for part in self.shared)
        return Snapshot(count, known, pairs, common, asked)

    def sampled(self, configuration: Configuration[Constant], asked: Asked) -> Snapshot:
        """The values of a configuration that was reached."""
        store = configuration.store

        def element(storage: Storage[Constant], number: int) -> Storage[Constant]:
            assert isinstance(storage, Tree)
            return storage.parts[number]

        robots = {
            number: self.held(robot, store, partial(element, number=number))
            for number, robot in enumerate(configuration.robots)
        }
        return self.snapshot(robots, store.allwrite, element, _set_value, len(robots), asked)

    def held(
        self, robot: Robot[V], store: Store[V], element: Callable[[Storage[V]], Storage[V]]
    ) -> Held[V]:
        """What a robot has; ``element`` takes its element of an array over robots."""
        shared: dict[Home, dict[int, Storage[V]]] = {home: {} for home in SHARED}
        for variable in dict.fromkeys(part.variable for part in (*self.own, *self.mutual)):
            if variable.home in shared:
                whole = store.allread if variable.home is Home.ALLREAD else store.allwrite
                shared[variable.home][variable.slot] = element(whole[variable.slot])
        own = {Home.LOCAL: robot.locals, Home.PORT: robot.ports}
        return shared | {home: dict(enumerate(kept)) for home, kept in own.items()}

    def rows(self, here: Snapshot) -> Iterator[Row]:
        """The choices of i, j and k: pairs of different robots, or one where there is no other."""
        numbers = list(here.robots)
        for i in numbers:
            for k in range(self.size):
                if len(numbers) == 1:
                    yield i, None, None, k
                for j in numbers:
                    if j != i:
                        yield i, j, None, k

    def triples(self, here: Snapshot) -> Iterator[Row]:
        """The choices of three different robots, and k."""
        for i, j, h in permutations(here.robots, 3):
            for k in range(self.size):
                yield i, j, h, k


def _set_value(cell: Cell[Constant], type_: Type) -> object:
    return cell.value if cell.is_set is True else UNSET


def _value(storage: Storage[V], part: Part, read: Callable[[Cell[V], Type], object]) -> object:
    steps = part.steps
    for k, step in enumerate(steps):
        assert isinstance(storage, Tree)
        if isinstance(step, core.IndexStep):
            rest = Part(part.variable, steps[k + 1 :], part.type)
            return tuple(_value(below, rest, read) for below in storage.parts)
        assert isinstance(step, core.FieldStep)
        storage = storage.parts[step.position]
    assert isinstance(storage, Cell)
    return read(storage, part.type)


# --- where robots change places ---------------------------------------------------------------


def _renamed(literals: Sequence[AnyLiteral], places: Mapping[int, int]) -> Renaming:
    """What literals are where robots have changed places."""
    numbers = {_mark(x, {}): n for n, x in enumerate(literals)}
    return tuple(numbers.get(_mark(x, places), _other_way(x, places, numbers)) for x in literals)


def _mark(x: AnyLiteral, places: Mapping[int, int]) -> Hashable:
    """What tells a literal from others, where robots have changed places."""
    match x:
        case Literal(left=left, op=op, right=right, positive=positive):
            return _placed(left, places), op, _placed(right, places), positive
        case ConditionLiteral(position=position, of=of, positive=positive):
            return position, places.get(of, of), positive
        case Between(positive=positive):
            # Where two change places it is the other way round.
            changed = sum(a != b for a, b in places.items())
            return "between", positive is (changed != 2)
        case Existence(witness=witness):
            return "there is", _mark(witness, {})
        case _:
            assert_never(x)


def _other_way(
    x: AnyLiteral, places: Mapping[int, int], numbers: Mapping[Hashable, int]
) -> int | None:
    """An equality the other way round."""
    if not isinstance(x, Literal) or x.op is not BinaryOp.EQ:
        return None
    mark = _placed(x.right, places), x.op, _placed(x.left, places), x.positive
    return numbers.get(mark)


def _placed(q: Quantity, places: Mapping[int, int]) -> tuple[object, ...]:
    of = sum(places.get(bit, bit) for bit in PLACES if q.of & bit)
    owner = places.get(q.owner, q.owner)
    return of, owner, *twin_of(q, whose=False)[2:]
