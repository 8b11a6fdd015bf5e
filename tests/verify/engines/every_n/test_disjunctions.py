"""The smallest disjunctions that held in all samples, beside all that there are."""

from __future__ import annotations

from itertools import combinations

from hypothesis import example, given
from hypothesis import strategies as st

from koord.syntax.budget import ENDLESS, Budget
from koord.verify.engines.every_n.disjunctions import Disjunction, Samples
from koord.verify.engines.every_n.language import Language
from tests.loading import program_of, protocol_text

LITERALS = 6
ROWS = st.lists(st.integers(0, 2**LITERALS - 1), min_size=1, max_size=20, unique=True)


def samples_of(rows: list[int]) -> Samples:
    """Samples of which each row is the bits of what holds in it."""
    language = Language.of_program(program_of(protocol_text("lock_server")))
    assert len(language.literals) >= LITERALS
    return Samples.of_rows(language, rows)


def smallest(rows: list[int], open_: list[int], most: int) -> set[Disjunction]:
    """By definition: each row has one of the literals, and not with one of these less."""
    found: set[Disjunction] = set()
    for size in range(1, most + 1):
        for x in combinations(open_, size):
            if all(any(row >> n & 1 for n in x) for row in rows) and not any(
                set(y) < set(x) for y in found
            ):
                found.add(x)
    return found


#: Three literals hold in all samples, of which two are enough: the last one and the first of the
#: others, or the second.
@example([0b011010, 0b001001, 0b100110], {0, 3, 5}, 3)
@example([0b110010, 0b001101, 0b101110], {0, 1, 4, 5}, 3)
@given(ROWS, st.sets(st.integers(0, LITERALS - 1)), st.integers(2, 5))
def test_they_are_the_smallest(rows: list[int], literals: set[int], most: int) -> None:
    open_ = sorted(literals)
    samples = samples_of(rows)
    found = samples._smallest(samples.full, open_, most, ENDLESS)
    assert len(found) == len(set(found))
    assert set(found) == smallest(rows, open_, most)


def test_what_is_false_again_is_known() -> None:
    """Of each of ten elements of an array the same is false: it is looked for once."""
    spent: list[int] = []
    budget, literals = Budget(lambda: False, heard=spent.append), list(range(LITERALS))
    samples = samples_of([0b000111, 0b111000, 0b010101])

    def found(without: int, most: int, times: int = 200) -> list[Disjunction]:
        return [samples._smallest(without, literals, most, budget) for _ in range(times)][-1]

    whole = found(samples.full, 3)
    assert not spent
    assert set(whole) == smallest([0b000111, 0b111000, 0b010101], literals, 3)
    assert set(found(samples.full, 2)) == smallest([0b000111, 0b111000, 0b010101], literals, 2)
    assert set(found(samples.full & 0b11, 3)) == smallest([0b000111, 0b111000], literals, 3)
