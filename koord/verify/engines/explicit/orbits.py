"""One representative for all states that differ by who is who. [SYMMETRY]

A renaming of robots moves each robot's own state to its new number, and renames robots in all
values (see ``symmetry``). To find the representative, robots are put in order of how they *look*:
their own state and where others name them, told without any number. Where looks leave several
orders, all are tried if they are few; otherwise one is taken as it comes, and some states
that differ by names alone stay apart, which costs time and nothing else.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from itertools import groupby, islice, permutations, product

from koord.syntax.analysis.sorts import Shape
from koord.syntax.analysis.symmetry import Symmetry
from koord.verify.engines.explicit.cells import CACHE_LIMIT, Cells, Interner
from koord.verify.engines.explicit.robot_names import Naming, Renaming
from koord.verify.engines.explicit.states import Own, State, Vault

#: How many orders of robots that look alike are tried.
ORDERS_TRIED = 24


class Orbits:
    """Representatives of the states of one search."""

    def __init__(self, vault: Vault, symmetry: Symmetry) -> None:
        self._vault = vault
        self._robots = vault.system.robots
        self._groups = symmetry.groups
        self._is_plain = symmetry.is_plain
        self._is_one_group = symmetry.groups == (tuple(range(self._robots)),)
        self._locals = [
            self._namings(*each) for each in zip(vault.locals, symmetry.locals, strict=True)
        ]
        self._ports = [
            self._namings(*each) for each in zip(vault.ports, symmetry.ports, strict=True)
        ]
        self._entries = self._namings(vault.entries, symmetry.entries)
        shared = self._namings(vault.allwrite, symmetry.allwrite)
        self._shared = [(slot, n) for slot, n in enumerate(shared) if n is not None]
        self._looks: Interner[Hashable] = Interner()
        self._own_looks: dict[tuple[int, int], int] = {}
        self._renamed_robots: dict[tuple[int, Renaming], int] = {}
        self._mentions: dict[int, bool] = {}
        self._known: dict[State, State] = {}

    def _namings(
        self, cells: Sequence[Cells], shapes: Sequence[Shape | None]
    ) -> list[Naming | None]:
        pairs = zip(cells, shapes, strict=True)
        return [Naming(c, of, self._robots) if of is not None else None for c, of in pairs]

    def representative(self, robots: tuple[int, ...], shared: tuple[int, ...]) -> State:
        """The state that stands for this one and all that differ from it by names alone."""
        if self._is_plain:
            return (*self._in_order(robots), *shared)
        state = (*robots, *shared)
        known = self._known.get(state)
        if known is None:
            if len(self._known) > CACHE_LIMIT:
                self._known.clear()
            known = self._known[state] = self._found(state)
        return known

    def _in_order(self, robots: tuple[int, ...]) -> Sequence[int]:
        """Robots by number of their state: all that matters where nothing names them."""
        if self._is_one_group:
            return sorted(robots)
        ordered = list(robots)
        for group in self._groups:
            for place, number in zip(group, sorted(robots[i] for i in group), strict=True):
                ordered[place] = number
        return ordered

    def _found(self, state: State) -> State:
        orders = islice(self._orders(state), ORDERS_TRIED)
        return min(self._renamed(state, renaming) for renaming in orders)

    def _orders(self, state: State) -> Iterator[Renaming]:
        """Renamings that put robots in order of their looks."""
        looks = self._all_looks(state)
        ordered = [sorted(group, key=looks.__getitem__) for group in self._groups]
        choices: list[list[tuple[int, ...]]] = []
        mentioned: bool | None = None
        for group in ordered:
            for _, alike in groupby(group, key=looks.__getitem__):
                same = tuple(alike)
                if len(same) > 1 and mentioned is None:
                    # Robots that look alike and that nobody names may come as they are.
                    mentioned = any(self._names_robots(number) for number in state[: self._robots])
                tried = len(same) in (2, 3, 4) and mentioned
                choices.append(list(permutations(same)) if tried else [same])
        places = [i for group in self._groups for i in group]
        for parts in product(*choices):
            renaming = list(range(self._robots))
            for place, robot in zip(places, (i for part in parts for i in part), strict=True):
                renaming[robot] = place
            yield tuple(renaming)

    # --- looks ----------------------------------------------------------------------------------

    def _all_looks(self, state: State) -> list[tuple[int, ...]]:
        """How each robot looks: its own state, and where the store names it."""
        count, number = self._robots, self._looks.number
        looks = [[self._own_look(i, state[i])] for i in range(count)]
        for slot, naming in self._shared:
            held = state[count + slot]
            for i in range(count):
                looks[i].append(number(naming.look(held, i)))
        return [tuple(look) for look in looks]

    def _own_look(self, robot: int, number: int) -> int:
        known = self._own_looks.get((number, robot))
        if known is None:
            own = self._vault.robots.values[number]
            told: list[Hashable] = [own.kind, own.status, own.ran]
            for held, naming in self._parts(own):
                told.append(held if naming is None else naming.told(held, robot))
            known = self._own_looks[number, robot] = self._looks.number(("own", *told))
        return known

    def _parts(self, own: Own) -> Iterator[tuple[int, Naming | None]]:
        """What a robot's variables hold, and who may be named in it."""
        yield from zip(own.locals, self._locals[own.kind], strict=True)
        yield from zip(own.ports, self._ports[own.kind], strict=True)
        yield from zip(own.entries, self._entries, strict=True)

    def _names_robots(self, number: int) -> bool:
        """Whether a robot's own state names robots, so that it might tell others apart."""
        known = self._mentions.get(number)
        if known is None:
            parts = self._parts(self._vault.robots.values[number])
            known = any(naming is not None and naming.names_any(held) for held, naming in parts)
            self._mentions[number] = known
        return known

    # --- renaming -------------------------------------------------------------------------------

    def _renamed(self, state: State, renaming: Renaming) -> State:
        count = self._robots
        renamed = list(state)
        for robot, place in enumerate(renaming):
            renamed[place] = self._renamed_robot(state[robot], renaming)
        for slot, naming in self._shared:
            renamed[count + slot] = naming.renamed(state[count + slot], renaming)
        return tuple(renamed)

    def _renamed_robot(self, number: int, renaming: Renaming) -> int:
        known = self._renamed_robots.get((number, renaming))
        if known is None:
            own = self._vault.robots.values[number]
            numbers = [
                held if naming is None else naming.renamed(held, renaming)
                for held, naming in self._parts(own)
            ]
            first, second = len(own.locals), len(own.locals) + len(own.ports)
            renamed = own._replace(
                locals=tuple(numbers[:first]),
                ports=tuple(numbers[first:second]),
                entries=tuple(numbers[second:]),
            )
            known = self._renamed_robots[number, renaming] = self._vault.robots.number(renamed)
        return known
