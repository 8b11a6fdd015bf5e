"""Machine code that renames robots: one state for many that differ by names alone. [SYMMETRY]

Robots of a group are put in order of how they *look*, a number made of what they hold and of where
others name them, told without robots' numbers. Where looks are equal robots stay in the order that
they had. Any renaming is sound; one that depends on more than looks costs states and nothing else.
"""

from __future__ import annotations

from random import Random
from typing import Any

from koord.kernels.assembling import BYTES, I64, Cells, Code, Ir, word, words_of
from koord.kernels.layout import PackedCell

#: So many times looks are told apart by the looks of robots that they name.
_REFINEMENTS = 2

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
    """``canonical(state, out, names)``: the state renamed, and each robot's new number."""
    code = Code(module, "canonical", (BYTES, BYTES, BYTES), I64)
    _Renaming(module, code, cells).write()
    code.b.ret(word(0))
    return code.function


class _Renaming:
    def __init__(self, module: Any, code: Code, cells: Cells) -> None:
        self.module, self.code, self.cells, self.b = module, code, cells, code.b
        self.layout = cells.layout
        self.count = len(self.layout.robots)
        self.salts = _Salts()
        self.state, self.out, self.names = code.arguments
        self.groups = self.layout.symmetry.groups if self.layout.symmetry is not None else ()

    def write(self) -> None:
        code = self.code
        for i in range(self.count):
            code.put(self.names, 8 * i, word(i))
        code.copy(self.out, self.state, self.cells.state_bytes)
        if not self.groups:
            return
        looks = self._looks()
        order: list[Ir] = [word(i) for i in range(self.count)]
        for group in self.groups:
            self._sort(group, looks, order)
        for place, robot in enumerate(order):
            code.put(self.names, self._times8(robot), word(place))
        self._move(order)
        self._rename()

    def _times8(self, number: Ir) -> Ir:
        return self.b.shl(number, word(3))

    # --- looks ----------------------------------------------------------------------------------

    def _value(self, number: int) -> Ir:
        value = self.cells.read(self.code, self.state, number)
        return value if value.type == I64 else self.b.zext(value, I64)

    def _is_robot(self, value: Ir) -> Ir:
        return self.b.icmp_unsigned("<", value, word(self.count))

    def _mixed(self, value: Ir, salt: Ir) -> Ir:
        b = self.b
        value = b.mul(b.add(value, salt), word(_MULTIPLIER))
        value = b.mul(b.xor(value, b.lshr(value, word(32))), word(_MULTIPLIER))
        return b.xor(value, b.lshr(value, word(29)))

    def _told(self, cell: PackedCell, number: int) -> Ir:
        """What a cell holds, without numbers of robots: which of its own it is, or that it is."""
        value = self._value(number)
        if not cell.names:
            return value
        told = self.b.select(self._is_robot(value), self.salts.of("other"), value)
        for position, robot in enumerate(cell.index):
            mine = self.b.icmp_signed("==", value, word(robot))
            told = self.b.select(mine, self.salts.of("own", position), told)
        return told

    def _looks(self) -> list[Ir]:
        """The looks of all robots."""
        b, code = self.b, self.code
        sums: list[Ir] = [word(0)] * self.count
        named = code.block(8 * (self.count + 1))  # the last one is of numbers that are no robots'
        for i in range(self.count + 1):
            code.put(named, 8 * i, word(0))
        related = False
        for number, cell in enumerate(self.layout.cells):
            if len(cell.index) == 1:
                robot = cell.index[0]
                told = b.add(self._told(cell, number), sums[robot])
                sums[robot] = b.mul(b.xor(told, b.lshr(told, word(31))), word(_MULTIPLIER))
                related |= cell.names
            related |= len(cell.index) > 1
            if cell.names and not cell.index:
                self._name(named, self._value(number), self.salts.of("named", cell.base))
        looks = [
            self._mixed(sums[i], b.mul(code.get(named, 8 * i, I64), word(_MULTIPLIER)))
            for i in range(self.count)
        ]
        for _ in range(_REFINEMENTS if related else 0):
            looks = self._refined(looks, named)
        return looks

    def _name(self, named: Ir, value: Ir, amount: Ir) -> None:
        """Add to the sum of the robot that a value names."""
        place = self._times8(self.b.select(self._is_robot(value), value, word(self.count)))
        self.code.put(named, place, self.b.add(self.code.get(named, place, I64), amount))

    def _refined(self, looks: list[Ir], named: Ir) -> list[Ir]:
        """Looks, by how the robots look that they have to do with."""
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
            if cell.names:
                value = self._value(number)
                place = self._times8(b.select(self._is_robot(value), value, word(self.count)))
                its = code.get(table, place, I64)
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
        """Give robots in values their new numbers."""
        code, cells, b = self.code, self.cells, self.b
        for number, cell in enumerate(self.layout.cells):
            if not cell.names:
                continue
            value = cells.read(code, self.out, number)
            is_robot = self._is_robot(value)
            place = self._times8(b.select(is_robot, value, word(0)))
            new = b.select(is_robot, code.get(self.names, place, I64), value)
            code.put(self.out, number * cells.size, cells.narrow(code, new))


def _flat(index: tuple[int, ...], count: int) -> int:
    flat = 0
    for robot in index:
        flat = flat * count + robot
    return flat
