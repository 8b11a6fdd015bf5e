"""Values and storage on both domains, operation by operation: what whole programs meet rarely."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

import pytest

from koord.refinement.generating.palette import Path, Way, end, palette, paths
from koord.semantics.domain import EXACT, Constant
from koord.semantics.locations import (
    AtField,
    AtIndex,
    AtKey,
    Location,
    joined,
    marked,
    part_of,
    write,
    written,
)
from koord.semantics.storage import Cell, Storage, Tree, contents, stored
from koord.semantics.values import Table, Value, equal, insert, lookup, put_at, without
from koord.syntax.types import BOOL, INT, MapType, Type
from koord.verify.encoding.terms import Term, Terms
from tests.agreement.flattening import (
    Meaning,
    exact_storage,
    exact_value,
    flat_storage,
    flat_value,
    meaning_of,
)
from tests.agreement.symbols import Symbols
from tests.generators.configurations import Concrete, storage, value
from tests.sampling import blocks

ROBOTS = 2


class Pair:
    """Random values of a random type, concrete and as symbols."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self.type: Type = self.random.choice(palette(self.random, finite=False).all)
        self.symbols = Symbols(Terms(), self.random, ROBOTS, self.random.choice((1.0, 0.7)))
        self.d = self.symbols.d

    def value(self, type_: Type | None = None) -> Concrete:
        return value(self.random, type_ or self.type, ROBOTS)

    def storage(self) -> Storage[Constant]:
        return storage(self.random, self.type, ROBOTS, unset_rate=0.1)

    def path(self) -> tuple[Path, Type]:
        path = self.random.choice(list(paths(self.type)))
        return path, end(self.type, path)

    def locations(self, path: Path) -> list[tuple[Location[Constant], Location[Term]]]:
        return list(self._locations(path))

    def _locations(self, path: Path) -> Iterator[tuple[Location[Constant], Location[Term]]]:
        for stage in path:
            match stage.way:
                case Way.FIELD:
                    yield AtField(stage.position), AtField(stage.position)
                case Way.INDEX:
                    index = self.random.choice((-1, 0, 0, 1, 1, 2))
                    yield AtIndex(index), AtIndex(self.symbols.scalar(index, INT))
                case Way.KEY:
                    assert isinstance(stage.above, MapType)
                    key = self.value(stage.above.key)
                    yield AtKey(key), AtKey(self.symbols.value(key, stage.above.key))

    def meaning(self, *results: object) -> Meaning[Term]:
        return meaning_of(self.symbols, results)


SEEDS = pytest.mark.parametrize("seeds", blocks(60, of=500, count=4))


@SEEDS
def test_equality(seeds: range) -> None:
    for seed in seeds:
        p = Pair(seed)
        left = p.value()
        right = left if p.random.random() < 0.5 else p.value()
        same = equal(p.d, p.symbols.value(left, p.type), p.symbols.value(right, p.type))
        assert p.meaning(same)(same, BOOL) == equal(EXACT, left, right), seed


@SEEDS
def test_parts(seeds: range) -> None:
    for seed in seeds:
        p = Pair(seed)
        path, _ = p.path()
        whole = p.value()
        symbolic: Value[Term] = p.symbols.value(whole, p.type)
        for stage, (location, symbolic_location) in zip(path, p.locations(path), strict=True):
            part, legal = part_of(EXACT, whole, location)
            symbolic_part, symbolic_legal = part_of(p.d, symbolic, symbolic_location)
            meaning = p.meaning(symbolic_part, symbolic_legal)
            assert meaning(symbolic_legal, BOOL) == legal, seed
            if not legal:
                break
            assert part is not None
            assert symbolic_part is not None
            flat = flat_value(meaning, symbolic_part, stage.type)
            assert flat == exact_value(part, stage.type), seed
            whole, symbolic = part, symbolic_part


@SEEDS
def test_writes_and_joins(seeds: range) -> None:
    """Two writes to a copy; their masks; the written locations put into another store."""
    for seed in seeds:
        p = Pair(seed)
        target = p.storage()
        symbolic_target = p.symbols.storage(target, p.type)
        source = p.storage()
        symbolic_source = p.symbols.storage(source, p.type)
        mask, symbolic_mask = None, None
        for _ in range(2):
            path, type_ = p.path()
            locations = p.locations(path)
            concrete = [location for location, _ in locations]
            symbolic = [location for _, location in locations]
            fresh = p.value(type_)
            changed, legal = write(EXACT, source, concrete, _fresh(p, source, path, fresh, type_))
            symbolic_fresh = p.symbols.value(fresh, type_)
            written_part = _symbolic_fresh(p, symbolic_source, path, symbolic_fresh, type_)
            symbolic_changed, symbolic_legal = write(p.d, symbolic_source, symbolic, written_part)
            meaning = p.meaning(symbolic_changed, symbolic_legal)
            assert meaning(symbolic_legal, BOOL) == legal, seed
            if not legal:
                break
            flat = flat_storage(meaning, symbolic_changed, p.type)
            assert flat == exact_storage(changed, p.type), seed
            mask = marked(EXACT, mask, source, concrete, True)
            always = p.symbols.scalar(True, BOOL)
            symbolic_mask = marked(p.d, symbolic_mask, symbolic_source, symbolic, always)
            source, symbolic_source = changed, symbolic_changed
        after = joined(EXACT, target, source, mask)
        symbolic_after = joined(p.d, symbolic_target, symbolic_source, symbolic_mask)
        any_written = written(p.d, symbolic_mask)
        meaning = p.meaning(symbolic_after, any_written)
        assert meaning(any_written, BOOL) == written(EXACT, mask)
        flat = flat_storage(meaning, symbolic_after, p.type)
        assert flat == exact_storage(after, p.type), seed


def _fresh(
    p: Pair, whole: Storage[Constant], path: Path, fresh: Concrete, type_: Type
) -> Storage[Constant]:
    return stored(EXACT, type_, fresh, ROBOTS) if _ends_in_tree(whole, path) else Cell(True, fresh)


def _symbolic_fresh(
    p: Pair, whole: Storage[Term], path: Path, fresh: Value[Term], type_: Type
) -> Storage[Term]:
    return stored(p.d, type_, fresh, ROBOTS) if _ends_in_tree(whole, path) else Cell(True, fresh)


def _ends_in_tree(whole: Storage[Constant] | Storage[Term], path: Path) -> bool:
    """Whether the place that a path leads to is storage of its own, not inside an atom."""
    part: Storage[Constant] | Storage[Term] = whole
    for stage in path:
        if not isinstance(part, Tree):
            return False
        part = part.parts[stage.position if stage.way is Way.FIELD else 0]
    return True


@SEEDS
def test_items(seeds: range) -> None:
    """Putting in and taking out, at positions that are not known."""
    for seed in seeds:
        p = Pair(seed)
        items = [p.value() for _ in range(p.random.randint(0, 3))]
        symbolic = [p.symbols.value(item, p.type) for item in items]
        position = p.random.randint(0, len(items))
        symbolic_position = p.symbols.scalar(position, INT)
        added = p.value()
        put = put_at(EXACT, position, items, added)
        symbolic_put = put_at(p.d, symbolic_position, symbolic, p.symbols.value(added, p.type))
        meaning = p.meaning(symbolic_put)
        flat = [flat_value(meaning, item, p.type) for item in symbolic_put]
        wanted = [exact_value(item, p.type) for item in put]
        assert flat[: len(wanted) if position == len(items) else len(items)] == wanted, seed
        if position < len(items):
            rest = without(EXACT, position, items)
            symbolic_rest = without(p.d, symbolic_position, symbolic)
            meaning = p.meaning(symbolic_rest)
            taken = [flat_value(meaning, item, p.type) for item in symbolic_rest]
            assert taken[: len(rest)] == [exact_value(x, p.type) for x in rest], seed


@SEEDS
def test_maps(seeds: range) -> None:
    for seed in seeds:
        p = Pair(seed)
        type_ = MapType(p.random.choice((INT, BOOL)), p.type)
        entries, key, added = p.value(type_), p.value(type_.key), p.value()
        assert isinstance(entries, Table)
        symbolic = p.symbols.value(entries, type_)
        assert isinstance(symbolic, Table)
        symbolic_key = p.symbols.value(key, type_.key)
        found, there = lookup(EXACT, entries, key)
        symbolic_found, symbolic_there = lookup(p.d, symbolic, symbolic_key)
        grown = insert(EXACT, entries, key, added)
        symbolic_grown = insert(p.d, symbolic, symbolic_key, p.symbols.value(added, p.type))
        meaning = p.meaning(symbolic_found, symbolic_there, symbolic_grown)
        assert meaning(symbolic_found, BOOL) == found, seed
        flat = flat_value(meaning, symbolic_grown, type_)
        assert flat == exact_value(grown, type_), seed
        if there is not None:
            assert symbolic_there is not None
            flat = flat_value(meaning, symbolic_there, p.type)
            assert flat == exact_value(there, p.type), seed


@SEEDS
def test_contents_say_what_is_set(seeds: range) -> None:
    for seed in seeds:
        p = Pair(seed)
        whole = p.storage()
        held, all_set = contents(EXACT, whole, p.type)
        symbolic, symbolic_set = contents(p.d, p.symbols.storage(whole, p.type), p.type)
        meaning = p.meaning(symbolic, symbolic_set)
        assert meaning(symbolic_set, BOOL) == all_set, seed
        if all_set:
            flat = flat_value(meaning, symbolic, p.type)
            assert flat == exact_value(held, p.type), seed
