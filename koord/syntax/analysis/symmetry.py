"""Symmetry: groups of interchangeable robots of a system. [SYMMETRY]

**Decision.** A renaming σ of robots permutes robots of one kind. It acts on a configuration by
moving each robot's state to its new number, and by renaming, in every value, the integers of a sort
of robots (:mod:`koord.syntax.analysis.sorts`), and the order of arrays that such integers index.
If no sort is both one of robots and one of numbers, then for all σ that leave the numbers in the
text in place: c → c′ is a step if and only if σ(c) → σ(c′) is one, and a property holds in c if and
only if it does in σ(c).

**Why.** By induction over the evaluation of expressions and statements, e on σ(μ) gives σ of what e
gives on μ, faults included:

- ``pid`` of robot σ(i) is σ(i). A constant of a sort of robots is left in place by σ, or is no
  robot, and σ changes only robots. Any other scalar, and every integer of a sort of numbers, is
  unchanged, and so is all that is computed from such.
- A sort of robots is only stored, compared for equality, used as a key, searched for, or used as an
  index into an array that has an element for each robot and is itself reordered by σ: each of these
  commutes with an injective renaming.
- Values flow between places of one sort only, since flows unify. A list whose indices are robots
  is an array over robots, or in a bound variable and made from one: it is never written out,
  appended to, or shortened, so it always has one element per robot.
- A loop over all robots runs in another order on σ(μ). So its body may only do what does not depend
  on the order: :mod:`~koord.syntax.analysis.sort_inference`. The same holds of quantifiers, for a
  fault ends their evaluation early.
- Answers that are left open are tried all, and what is assumed of them is among the text that has
  been looked at.

The rules of rounds treat robots of one kind alike. So the states that can be reached are closed
under renaming, if the initial ones are, and these are by the same argument: INIT and assumptions
are part of the text.
"""

from __future__ import annotations

from msgspec import Struct

from koord.syntax import core
from koord.syntax.analysis.sort_inference import Sorting
from koord.syntax.analysis.sorts import Items, Shape, has_robots
from koord.syntax.system import System


class Symmetry(Struct, frozen=True):
    """A symmetry: ``groups`` of robots that may change places, by number.

    The shapes tell what is renamed in what a variable holds; None where nothing is. Locals and
    ports are by kind and slot, entries (of allread variables) and allwrite variables by slot.
    """

    groups: tuple[tuple[int, ...], ...]
    locals: tuple[tuple[Shape | None, ...], ...]
    ports: tuple[tuple[Shape | None, ...], ...]
    entries: tuple[Shape | None, ...]
    allwrite: tuple[Shape | None, ...]

    @property
    def is_plain(self) -> bool:
        """True if no value is renamed anywhere: then robots are simply put in order."""
        nested = (*self.locals, *self.ports, self.entries, self.allwrite)
        return all(part is None for parts in nested for part in parts)


class Asymmetry(Struct, frozen=True):
    """The reason why robots may not change places."""

    reason: str


def symmetry_of(system: System, properties: tuple[core.Property, ...]) -> Symmetry | Asymmetry:
    """The symmetry of a system that preserves some properties."""
    sorting = Sorting(system, properties)
    reason = sorting.run()
    if reason:
        return Asymmetry(reason)
    book = sorting.book
    fixed = book.fixed()
    groups: dict[int, list[int]] = {}
    for robot, kind in enumerate(system.kinds):
        if robot not in fixed:
            groups.setdefault(kind, []).append(robot)
    interchangeable = tuple(tuple(group) for group in groups.values() if len(group) > 1)
    if not interchangeable:
        return Asymmetry("no two robots are of one kind and without a role of their own")
    return Symmetry(
        interchangeable,
        tuple(_renamed(shapes) for shapes in book.locals),
        tuple(_renamed(shapes) for shapes in book.ports),
        _renamed([_element(of) for of in book.allread]),
        _renamed(book.allwrite),
    )


def _renamed(shapes: list[Shape]) -> tuple[Shape | None, ...]:
    return tuple(of if has_robots(of) else None for of in shapes)


def _element(of: Shape) -> Shape:
    assert isinstance(of, Items)
    return of.element
