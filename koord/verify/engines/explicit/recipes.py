"""Recipes: the writes of a turn, as functions of the contents before it.

A recipe is kept with the outcome of a turn and followed wherever the turn would go the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from msgspec import Struct

from koord.semantics.configurations import Store
from koord.semantics.domain import EXACT, Constant
from koord.semantics.locations import Mask, joined
from koord.semantics.storage import Cell, Storage, Tree
from koord.semantics.turns import Turned
from koord.semantics.values import Rec, Seq, Table, Value, map_atoms
from koord.verify.engines.explicit.cells import Cells, Codes, Scalars
from koord.verify.engines.explicit.lazy import PlaceOf
from koord.verify.engines.explicit.states import StateStore


class Recipe(NamedTuple):
    """A recipe of a content: its form, and for each scalar a code or the place to copy from."""

    form: int
    entries: tuple[int | PlaceOf, ...]
    is_constant: bool

    def codes(self, codes: Sequence[Codes]) -> Codes:
        """Compute the codes of the content, from those before the turn."""
        if self.is_constant:
            return self.entries  # type: ignore[return-value]
        return tuple(
            [e if type(e) is int else codes[e.variable][e.position] for e in self.entries]  # type: ignore[union-attr]
        )


def recipe(cells: Cells, scalars: Scalars, storage: Storage[Any]) -> Recipe:
    """The recipe of a content whose scalars are constants or places."""
    form, found = cells.taken_apart(storage)
    entries = tuple(
        value if isinstance(value, PlaceOf) else scalars.code(value, type_)
        for value, type_ in found
    )
    return Recipe(form, entries, not any(isinstance(e, PlaceOf) for e in entries))


# --- writes to allwrite variables -----------------------------------------------------------------


class VariableEffect(Struct, frozen=True):
    """The write of a turn to one allwrite variable.

    ``codes`` are those of the written ``positions``, or of the writer's whole view of the variable
    where ``positions`` is None. ``form`` is the form of that view. Where positions say which
    locations were written, the mask need not be told apart.
    """

    slot: int
    form: int
    positions: tuple[int, ...] | None
    codes: Codes
    told: Mask[Constant] | None
    mask: Mask[Constant]  #: it does not count where effects are compared

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, VariableEffect):
            return NotImplemented
        if self.slot != other.slot or self.form != other.form or self.codes != other.codes:
            return False
        return self.positions == other.positions and self.told == other.told

    def __hash__(self) -> int:
        return hash((self.slot, self.form, self.positions, self.codes, self.told))

    def put(self, cells: Cells, target: int) -> int:
        """The content of the variable after the write. [SHARED-ASSIGN]"""
        if self.mask.whole is True:
            return cells.numbered(self.form, self.codes)
        if self.positions is None:
            return self._joined(cells, target, self.codes)
        if cells.forms[target] == self.form:
            codes = list(cells.codes[target])
            for position, code in zip(self.positions, self.codes, strict=True):
                codes[position] = code
            return cells.numbered(self.form, tuple(codes))
        # Somebody changed the form before. What was not written is not looked at.
        view = [0] * len(cells.types(self.form))
        for position, code in zip(self.positions, self.codes, strict=True):
            view[position] = code
        return self._joined(cells, target, tuple(view))

    def _joined(self, cells: Cells, target: int, view: Codes) -> int:
        source = cells.storage(cells.numbered(self.form, view))
        return cells.number(joined(EXACT, cells.storage(target), source, self.mask))


class PartRecipe(Struct, frozen=True):
    """The recipe of a part. ``mask`` may hold places, in the keys of maps."""

    slot: int
    view: Recipe
    positions: tuple[int, ...] | None
    mask: Mask[Any]

    def part(self, scalars: Scalars, codes: Sequence[Codes]) -> VariableEffect:
        """Compute the write, from the codes before the turn."""
        view = self.view.codes(codes)
        mask = _known_mask(self.mask, scalars, codes)
        if self.positions is None or mask.whole is True:
            told = None if mask.whole is True else mask
            return VariableEffect(self.slot, self.view.form, None, view, told, mask)
        written = tuple([view[position] for position in self.positions])
        return VariableEffect(self.slot, self.view.form, self.positions, written, None, mask)


def part_recipe(
    slot: int, cells: Cells, scalars: Scalars, before: int, view: Storage[Any], mask: Mask[Any]
) -> PartRecipe:
    """Make the recipe of a write.

    ``before`` is the form that the variable had, ``view`` what the writer makes of it.
    """
    made = recipe(cells, scalars, view)
    positions = _Positions().of(view, mask) if made.form == before else None
    return PartRecipe(slot, made, tuple(positions) if positions is not None else None, mask)


class _NotPositionsError(Exception):
    """Raised where positions of scalars do not determine a written location."""


class _Positions:
    """The positions of the scalars that a mask covers."""

    def __init__(self) -> None:
        self._next = 0
        self._found: list[int] = []

    def of(self, storage: Storage[Any], mask: Mask[Any]) -> list[int] | None:
        try:
            self._visit(storage, mask, covered=False)
        except _NotPositionsError:
            return None
        return self._found

    def _visit(
        self, held: Storage[Any] | Value[Any], mask: Mask[Any] | None, *, covered: bool
    ) -> None:
        begins = mask is not None and mask.whole is True and not covered
        covered = covered or begins
        before = len(self._found)
        if mask is not None and mask.keys:
            raise _NotPositionsError
        match held:
            case Cell(is_set=is_set, value=value):
                if is_set is True:
                    self._visit(value, mask, covered=covered)
            case Tree(parts=parts) | Rec(fields=parts) | Seq(items=parts):
                masks = mask.parts if mask is not None else ()
                for k, part in enumerate(parts):
                    below = masks[k] if k < len(masks) else None
                    self._visit(part, below, covered=covered)
            case Table(entries=entries):
                for key, value in entries:
                    self._visit(key, None, covered=covered)
                    self._visit(value, None, covered=covered)
            case _:
                if covered:
                    self._found.append(self._next)
                self._next += 1
        if begins and len(self._found) == before:
            # An empty list was written: no position shows it.
            raise _NotPositionsError


def parts_written(
    vault: StateStore, before: Store[Constant], turned: Turned[Constant]
) -> tuple[VariableEffect, ...]:
    """The writes of a turn on known values."""
    scalars = vault.scalars
    made = []
    for slot, mask in sorted(turned.allwrite.items()):
        cells = vault.allwrite[slot]
        form, _ = cells.taken_apart(before.allwrite[slot])
        view = turned.robot.copy.allwrite[slot]
        made.append(part_recipe(slot, cells, scalars, form, view, mask).part(scalars, ()))
    return tuple(made)


# --- keys -----------------------------------------------------------------------------------------


def _known_mask(mask: Mask[Any], scalars: Scalars, codes: Sequence[Codes]) -> Mask[Constant]:
    """The mask with the values of its keys."""
    if not _has_keys(mask):
        return mask
    parts = tuple(_known_mask(p, scalars, codes) if p is not None else None for p in mask.parts)
    keys = tuple((when, _known(key, scalars, codes)) for when, key in mask.keys)
    return Mask(mask.whole, parts, keys)


def _has_keys(mask: Mask[Any]) -> bool:
    return bool(mask.keys) or any(part is not None and _has_keys(part) for part in mask.parts)


def _known(value: Any, scalars: Scalars, codes: Sequence[Codes]) -> Any:
    """The value with the values of its places."""

    def looked(atom: Any) -> Any:
        if not isinstance(atom, PlaceOf):
            return atom
        return scalars.value(codes[atom.variable][atom.position], atom.type)

    return map_atoms(value, looked)
