"""Machine code that renames robots and elements: one state for many that differ by names alone.
[SYMMETRY] [ELEMENTS]

Robots of a group are put in order of how they *look*, a number made of what they hold and of where
others name them, told without numbers of names. Where looks are equal robots stay in the order that
they had. Then elements are, by looks in which each robot is told by its new number. Any renaming is
sound; one that depends on more than looks costs states and nothing else.
"""

from __future__ import annotations

from random import Random
from typing import Any

from koord.kernels.assembling import Cells
from koord.kernels.layout import PackedCell
from koord.kernels.terms import NoKernelError
from koord.machine.code import BYTES, I64, Code, Ir, word, words_of
from koord.syntax.analysis.symmetry import Names

#: So many times looks are told apart by the looks of robots that they name.
_REFINEMENTS = 2

#: Tables of where things stand have so many entries at most.
_MOST_PLACES = 1 << 16

_MULTIPLIER = -7046029254386353131


class _Salts:
    """Numbers that look like random ones, always the same."""

    def __init__(self) -> None:
        self._known: dict[object, int] = {}
        self._random = Random(1)

    def of(self, *what: object) -> Ir:
        """The number of something."""
        if what not in self._known:
            self._known[what] = self._random.getrandbits(62) * 2 + 1 - 2**62
        return word(self._known[what])


def canonical_code(module: Any, cells: Cells) -> Ir:
    """``canonical(state, out, names)``: the state renamed, and the new places of all names."""
    code = Code(module, "canonical", (BYTES, BYTES, BYTES), I64)
    _Renaming(module, code, cells).write()
    code.b.ret(word(0))
    return code.function


class _Renaming:
    def __init__(self, module: Any, code: Code, cells: Cells) -> None:
        self.module, self.code, self.cells, self.b = module, code, cells, code.b
        self.layout = cells.layout
        self.count = self.layout.names
        self.salts = _Salts()
        self.state, self.out, self.names = code.arguments
        symmetry = self.layout.symmetry
        self.groups = symmetry.groups if symmetry is not None else ()
        self.elements = symmetry.elements if symmetry is not None else ()

    def write(self) -> None:
        code = self.code
        for i in range(self.count):
            code.put(self.names, 8 * i, word(i))
        code.copy(self.out, self.state, self.cells.state_bytes)
        if not self.groups and not self.elements:
            return
        looks, named = self._looks()
        order: list[Ir] = [word(i) for i in range(self.count)]
        sorted_ = list(looks)
        for group in self.groups:
            self._sort(group, sorted_, order)
        self._note(order)
        if self.elements:
            for i in range(len(self.layout.robots)):
                looks[i] = self._mixed(code.get(self.names, 8 * i, I64), self.salts.of("robot"))
            looks = self._refined(looks, named)
            for names in self.elements:
                for group in names.groups:
                    self._sort(group, looks, order)
            self._note(order)
        self._move(order)
        self._rename()

    def _note(self, order: list[Ir]) -> None:
        """Note the new places of names, by what stands at each."""
        for place, name in enumerate(order):
            self.code.put(self.names, self._times8(name), word(place))

    def _times8(self, number: Ir) -> Ir:
        return self.b.shl(number, word(3))

    # --- looks ----------------------------------------------------------------------------------

    def _value(self, number: int) -> Ir:
        value = self.cells.read(self.code, self.state, number)
        return value if value.type == I64 else self.b.zext(value, I64)

    def _is_name(self, names: Names, value: Ir) -> Ir:
        return self.b.icmp_unsigned("<", value, word(names.count))

    def _place(self, names: Names, value: Ir) -> Ir:
        """The place of what a value names among all names; behind them if it names nothing."""
        b = self.b
        return b.select(
            self._is_name(names, value), b.add(value, word(names.first)), word(self.count)
        )

    def _mixed(self, value: Ir, salt: Ir) -> Ir:
        b = self.b
        value = b.mul(b.add(value, salt), word(_MULTIPLIER))
        value = b.mul(b.xor(value, b.lshr(value, word(32))), word(_MULTIPLIER))
        return b.xor(value, b.lshr(value, word(29)))

    def _told(self, cell: PackedCell, number: int) -> Ir:
        """What a cell holds, without numbers of names: which of its own it is, or that it is."""
        value = self._value(number)
        if cell.names is None:
            return value
        told = self.b.select(self._is_name(cell.names, value), self.salts.of("other"), value)
        for position, name in enumerate(cell.index):
            if not cell.names.first <= name < cell.names.first + cell.names.count:
                continue
            mine = self.b.icmp_signed("==", value, word(name - cell.names.first))
            told = self.b.select(mine, self.salts.of("own", position), told)
        return told

    def _looks(self) -> tuple[list[Ir], Ir]:
        """The looks of all names, and a block that has room for all."""
        b, code = self.b, self.code
        sums: list[Ir] = [word(0)] * self.count
        named = code.block(8 * (self.count + 1))  # the last one is of what names nothing
        for i in range(self.count + 1):
            code.put(named, 8 * i, word(0))
        related = False
        for number, cell in enumerate(self.layout.cells):
            if len(cell.index) == 1:
                robot = cell.index[0]
                told = b.add(self._told(cell, number), sums[robot])
                sums[robot] = b.mul(b.xor(told, b.lshr(told, word(31))), word(_MULTIPLIER))
                related |= cell.names is not None
            related |= len(cell.index) > 1
            if cell.names is not None and not cell.index:
                value = self._place(cell.names, self._value(number))
                self._name(named, value, self.salts.of("named", cell.base))
        looks = [
            self._mixed(sums[i], b.mul(code.get(named, 8 * i, I64), word(_MULTIPLIER)))
            for i in range(self.count)
        ]
        for _ in range(_REFINEMENTS if related else 0):
            looks = self._refined(looks, named)
        return looks, named

    def _name(self, named: Ir, place: Ir, amount: Ir) -> None:
        """Add to the sum of what a value names."""
        place = self._times8(place)
        self.code.put(named, place, self.b.add(self.code.get(named, place, I64), amount))

    def _refined(self, looks: list[Ir], named: Ir) -> list[Ir]:
        """Looks, by how the names look that they have to do with."""
        b, code, salts = self.b, self.code, self.salts
        table = code.block(8 * (self.count + 1))
        for i in range(self.count):
            code.put(table, 8 * i, looks[i])
            code.put(named, 8 * i, word(0))
        code.put(table, 8 * self.count, word(0))
        sums = list(looks)
        for number, cell in enumerate(self.layout.cells):
            if not cell.index:
                continue
            told = self._told(cell, number)
            if len(cell.index) > 1:
                for position, robot in enumerate(cell.index):
                    others = told
                    for place, other in enumerate(cell.index):
                        if place != position:
                            salt = salts.of("at", place, other == robot)
                            others = b.xor(others, b.mul(looks[other], salt))
                    amount = self._mixed(others, salts.of("in", cell.base, position))
                    sums[robot] = b.add(sums[robot], amount)
            if cell.names is not None:
                value = self._place(cell.names, self._value(number))
                its = code.get(table, self._times8(value), I64)
                for position, robot in enumerate(cell.index):
                    amount = self._mixed(its, salts.of("names", cell.base, position))
                    sums[robot] = b.add(sums[robot], amount)
                    seen = self._mixed(looks[robot], salts.of("by", cell.base, position))
                    self._name(named, value, seen)
        return [self._mixed(sums[i], code.get(named, 8 * i, I64)) for i in range(self.count)]

    # --- order ----------------------------------------------------------------------------------

    def _sort(self, group: tuple[int, ...], looks: list[Ir], order: list[Ir]) -> None:
        """Put the robots of a group in order of their looks, equal ones as they stand."""
        b = self.b
        for end in range(len(group) - 1, 0, -1):
            for k in range(end):
                one, two = group[k], group[k + 1]
                swapped = b.icmp_signed(">", looks[one], looks[two])
                for of in (looks, order):
                    of[one], of[two] = (
                        b.select(swapped, of[two], of[one]),
                        b.select(swapped, of[one], of[two]),
                    )

    # --- renaming -------------------------------------------------------------------------------

    def _move(self, order: list[Ir]) -> None:
        """Put what stands at robots to where they are now."""
        code, cells, layout = self.code, self.cells, self.layout
        firsts = self._table("firsts", [r.first * cells.size for r in layout.robots])
        changing = {i for group in self.groups for i in group}
        for place in sorted(changing):
            own = layout.robots[place]
            source = code.get(firsts, self._times8(order[place]), I64)
            size = (own.end - own.first) * cells.size
            code.copy(code.at(self.out, own.first * cells.size), code.at(self.state, source), size)
        stands: dict[int, dict[tuple[int, ...], int]] = {}
        for number, cell in enumerate(layout.cells):
            stands.setdefault(cell.base, {})[cell.index] = number
        for base, by_index in stands.items():
            places = len(next(iter(by_index)))
            is_shared = min(by_index.values()) >= layout.shared_first
            if places < 2 and not (is_shared and places == 1):
                continue
            if self.count**places > _MOST_PLACES:
                raise NoKernelError("arrays over robots and elements have too many places")
            offsets = [0] * self.count**places
            for index, number in by_index.items():
                offsets[_flat(index, self.count)] = number * cells.size
            table = self._table(f"of{base}", offsets)
            for index, number in by_index.items():
                flat = word(0)
                for robot in index:
                    flat = self.b.add(self.b.mul(flat, word(self.count)), order[robot])
                source = code.get(table, self._times8(flat), I64)
                held = code.get(code.at(self.state, source), 0, cells.type)
                code.put(self.out, number * cells.size, held)

    def _table(self, name: str, numbers: list[int]) -> Ir:
        return words_of(self.module, f"canonical.{name}", numbers)

    def _rename(self) -> None:
        """Give names in values their new numbers."""
        code, cells, b = self.code, self.cells, self.b
        for number, cell in enumerate(self.layout.cells):
            if cell.names is None:
                continue
            value, first = cells.read(code, self.out, number), word(cell.names.first)
            is_name = self._is_name(cell.names, value)
            place = self._times8(b.select(is_name, b.add(value, first), word(0)))
            new = b.select(is_name, b.sub(code.get(self.names, place, I64), first), value)
            code.put(self.out, number * cells.size, cells.narrow(code, new))


def _flat(index: tuple[int, ...], count: int) -> int:
    flat = 0
    for robot in index:
        flat = flat * count + robot
    return flat
