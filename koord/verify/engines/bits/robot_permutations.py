"""Permutations of robots: the images of an excluded cube are excluded as well. [SYMMETRY]

Bits are told apart by name. Nothing hangs on it that a name is read aright: a clause that does not
hold would show when the invariant is checked.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import permutations
from math import perm

from msgspec import Struct, field
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.analysis.sorts import Items, Scalar, Shape
from koord.syntax.analysis.symmetry import Symmetry, symmetry_of
from koord.syntax.system import System
from koord.syntax.types import is_by_robot
from koord.verify.engines.bits.circuit import Latch
from koord.verify.engines.bits.ic3 import Cube

#: A cube with more images than that has none. One of three robots of twenty has 6,840: without them
#: every image of what is excluded later is asked about.
MANY = 8_000


def images(
    system: System, properties: tuple[core.Property, ...] | None, latches: Sequence[Latch]
) -> Callable[[Cube], list[Cube] | None]:
    """A function from a cube to its images under symmetry, or to None if there is no symmetry."""
    if properties is None:
        return lambda cube: None
    found = symmetry_of(speaking_last(system), properties)
    if not isinstance(found, Symmetry):
        return lambda cube: None
    return _Renaming(system, found, latches).of


def speaking_last(system: System) -> System:
    """The system with its functions sorted: those with summaries after the functions these use.

    Functions that stand for list expressions come last in the program, and are spoken of before.
    """
    externals = tuple(sorted(system.program.externals, key=lambda e: bool(e.ensures)))
    return replace(system, program=replace(system.program, externals=externals))


class _Place(Struct, frozen=True):
    """A bit's name without its robots, and those robots."""

    name: str
    robots: tuple[int, ...]


class _Renaming(Struct):
    system: System
    symmetry: Symmetry
    latches: Sequence[Latch]
    _places: list[_Place | None] = field(default_factory=list)
    _numbers: dict[_Place, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        program = self.system.program
        arrays = [x.variable.name for x in program.allread]
        arrays += [x.variable.name for x in program.allwrite if _is_by_robot(x)]
        indexed = "|".join(re.escape(name) for name in arrays)
        robots = r"@(\d+)" + (rf"|\b(?:{indexed})\.(\d+)" if indexed else "")
        pattern = re.compile(robots)
        held = self._holding_robots()
        for number, latch in enumerate(self.latches, start=1):
            # The condition is the variable's name, as the text has it, in front of the name.
            of = [name for name in held if re.search(rf"\b{re.escape(name)}\b", latch.name)]
            if of and not (all(held[name] for name in of) and self._is_above(latch.name)):
                self._places.append(None)
                continue
            who = tuple(int(a or b or 0) for a, b in _groups(pattern, latch.name))
            place = _Place(pattern.sub(_without_number, latch.name), who)
            self._places.append(place)
            self._numbers[place] = number

    def of(self, cube: Cube) -> list[Cube] | None:
        """The images of a cube, or None if they are not cubes, or too many."""
        places = [self._places[abs(x) - 1] for x in cube]
        if None in places:
            return None
        robots = sorted({r for place in places if place is not None for r in place.robots})
        moving = [r for r in robots if any(r in group for group in self.symmetry.groups)]
        groups = [group for group in self.symmetry.groups if set(group) & set(moving)]
        if not groups:
            return [] if not robots else None
        if len(groups) > 1 or len(moving) < len(robots):
            return None
        if perm(len(groups[0]), len(robots)) > MANY:
            return None
        found: list[Cube] = []
        for others in permutations(groups[0], len(robots)):
            image = self._image(cube, places, dict(zip(robots, others, strict=True)))
            if image is None:
                return None
            if image != cube:
                found.append(image)
        return found

    def _image(
        self, cube: Cube, places: Sequence[_Place | None], to: dict[int, int]
    ) -> Cube | None:
        found = []
        for x, place in zip(cube, places, strict=True):
            assert place is not None
            moved = _Place(place.name, tuple(to[r] for r in place.robots))
            number = self._numbers.get(moved)
            if number is None:
                return None
            found.append(number if x > 0 else -number)
        return tuple(sorted(found))

    def _is_above(self, name: str) -> bool:
        """Return whether a number's bit is none of those that tell robots apart.

        It is the same in all robots' numbers, and what is no robot's number is not renamed.
        """
        found = re.search(r"\.(\d+)$", name)
        return found is not None and int(found[1]) >= (self.system.robots - 1).bit_length()

    def _holding_robots(self) -> dict[str, bool]:
        """Variables whose values change when robots are renamed, other than by index.

        To each, whether it is a number, or numbers of which the index says which.
        """
        program, symmetry = self.system.program, self.symmetry
        pairs: list[tuple[core.Declaration, Shape | None]] = [
            *zip(program.allread, symmetry.entries, strict=True)
        ]
        for x, shape in zip(program.allwrite, symmetry.allwrite, strict=True):
            if not _is_by_robot(x):
                pairs.append((x, shape))
        for agent, shapes in zip(program.agents, symmetry.locals, strict=True):
            pairs += zip(agent.locals, shapes, strict=True)
        for agent, shapes in zip(program.agents, symmetry.ports, strict=True):
            pairs += zip([port.declaration for port in agent.ports], shapes, strict=True)
        held: dict[str, bool] = {}
        for x, shape in pairs:
            if shape is not None:
                name = x.variable.name
                held[name] = held.get(name, True) and _is_of_numbers(shape, self.symmetry)
        return held


def _is_of_numbers(shape: Shape, symmetry: Symmetry) -> bool:
    """Return whether a variable is a number, or an array of numbers that no names index."""
    if isinstance(shape, Items):
        return symmetry.of(shape.index) is None and isinstance(shape.element, Scalar)
    return isinstance(shape, Scalar)


def _is_by_robot(entry: core.Declaration) -> bool:
    return is_by_robot(entry.variable.type)


def _groups(pattern: re.Pattern[str], name: str) -> list[tuple[str, str]]:
    return [(*found.groups(), "")[:2] for found in pattern.finditer(name)]  # type: ignore[misc]


def _without_number(found: re.Match[str]) -> str:
    return re.sub(r"\d+$", "#", found.group())
