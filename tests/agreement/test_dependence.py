"""Machine code that finds which choices matter: the others change nothing. [CHOOSE]"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from random import Random
from typing import Any

import numpy as np
import pytest

from koord.syntax.core import BinaryOp
from koord.syntax.system import dealt
from tests.agreement.test_terms import PROGRAM, Recipe, cooked, number, states, truth
from tests.loading import program_of
from tests.sampling import blocks

pytest.importorskip("llvmlite")

from llvmlite import ir

from koord.kernels.assembling import Cells, Evaluation
from koord.kernels.dependence import Dependence
from koord.kernels.layout import Layout
from koord.kernels.terms import Scalar, TermDomain
from koord.kernels.turn_code import FLAGS, choices_of, to_next
from koord.kernels.turns import TurnTerms
from koord.machine.code import BYTES, I1, I64, Code, Loaded, word

#: The letters b, c and q of expressions are what is chosen, from so many options.
COUNTS = (3, 4, 2)
TURN = TurnTerms(COUNTS, True, False, (), (), ())


class Machine:
    """Machine code of some terms of cells and of choices: values, what they hang on, and steps."""

    def __init__(self, recipes: Sequence[Recipe]) -> None:
        layout = Layout(dealt(program_of(PROGRAM), 1), None, frozenset(), tracks_ran=False)
        self._cells = Cells(layout, 8)
        d = TermDomain()
        letters = {
            "a": d.cell(0, (-128, 127)),
            "b": d.choice(0, COUNTS[0]),
            "c": d.choice(1, COUNTS[1]),
            "p": d.cell(3, None),
            "q": d.binary(BinaryOp.EQ, d.choice(2, COUNTS[2]), 1),
        }
        module = ir.Module("dependence")
        for k, recipe in enumerate(recipes):
            for what in ("value", "hangs", "next"):
                self._write(module, f"{what}_{k}", what, cooked(d, recipe, letters))
        self._loaded = Loaded(module)

    def _write(self, module: Any, name: str, what: str, term: Scalar) -> None:
        code = Code(module, name, (BYTES, I64), I64)
        state, chosen = code.arguments
        terms = Evaluation(code, self._cells, state, choices_of(code, COUNTS, chosen))
        if what == "value":
            value = terms.value(term)
            code.b.ret(code.b.zext(value, I64) if value.type == I1 else value)
            return
        hangs = Dependence(terms).of(term)
        if what == "hangs":
            code.b.ret(word(0) if hangs is None else hangs)
        else:
            code.b.ret(code.b.lshr(to_next(code, TURN, hangs), word(FLAGS)))

    def run(self, what: str, term: int, cells: dict[str, Any], chosen: int) -> int:
        state = np.zeros(self._cells.state_bytes, dtype=np.int8)
        state[: len(cells)] = [int(cells[letter]) for letter in "abcpq"]
        return self._loaded.function(f"{what}_{term}", 2)(state.ctypes.data, chosen)


@pytest.mark.parametrize("seeds", blocks(2, of=8, count=2))
def test_choices_that_do_not_matter_change_nothing(seeds: range) -> None:
    """Neither the value, nor what is found by going from one combination to the next."""
    skipped = 0
    for seed in seeds:
        random = Random(seed)
        recipes = [random.choice((number, truth))(random, 3) for _ in range(40)]
        machine = Machine(recipes)
        all_ = list(product(*map(range, COUNTS)))
        for k, cells in product(range(len(recipes)), list(states(random, 3))):
            values = [machine.run("value", k, cells, n) for n in range(len(all_))]
            for chosen, first in enumerate(all_):
                hangs = machine.run("hangs", k, cells, chosen)
                alike = [
                    value
                    for value, other in zip(values, all_, strict=True)
                    if all(first[i] == other[i] for i in range(3) if hangs >> i & 1)
                ]
                assert set(alike) == {values[chosen]}, (seed, recipes[k], cells, first)
            visited, found = 0, set()
            while visited < len(all_):
                found.add(values[visited])
                visited += machine.run("next", k, cells, visited)
                skipped += 1
            assert found == set(values), (seed, recipes[k], cells)
    assert skipped < len(seeds) * 40 * 3 * len(all_) // 2


def test_what_decides_by_itself_leaves_the_rest_open() -> None:
    both: Recipe = (BinaryOp.AND, "p", "q")
    either: Recipe = (BinaryOp.OR, "p", "q")
    machine = Machine([both, either, ("ite", "p", "b", "c")])
    cells = {"a": 0, "b": 0, "c": 0, "p": False, "q": False}
    assert [machine.run("hangs", k, cells, 0) for k in range(3)] == [0, 4, 2]
    cells["p"] = True
    assert [machine.run("hangs", k, cells, 0) for k in range(3)] == [4, 0, 1]
