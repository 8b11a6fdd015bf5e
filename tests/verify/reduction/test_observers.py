"""Lists and maps of any length are looked into by observers. [T-OBSERVE]"""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Any

import pytest

import koord
from koord.semantics.domain import EXACT
from koord.semantics.expressions import statement
from koord.semantics.oracle import Key
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.semantics.values import Seq, Table
from koord.syntax import core
from koord.syntax.source import Source
from koord.syntax.system import dealt
from koord.syntax.types import INT, ListType, MapType, OpaqueType, Type
from koord.verify.engine_names import Engine
from koord.verify.reduction.abstraction import Abstraction, abstracted
from koord.verify.reduction.observers import Observer
from koord.verify.reduction.problems import _map_of, _merged, _of_parts
from koord.verify.verdicts import Outcome
from tests.loading import program_of

#: Robots plan ways, which may have any number of points, and keep the last one that was found.
WAYS = """\
using Motion:
  sensors:
    pos psn
    bool reached
  actuators:
    pos[] path

local:
  pos goal = pos(0.0, 0.0, 0.0)
  pos[] way = []

Plan:
  pre: Motion.reached
  eff:
    goal = Motion.psn
    way = findPath(Motion.psn, goal)
    if length(way) > 0:
      Motion.path = way

"""

#: Robots merge what they see into one map.
MAPS = """\
param int cells = 3

def fun isWall(int cell) -> bool: extern

def fun look(pos[] scan) -> Map<int, bool>:
  extern
  ensures: forall c in 0, cells: contains(result, c) implies result[c] == isWall(c)

using MotionWithScan:
  sensors:
    pos[] pscan

allwrite:
  Map<int, bool> known = {}

local:
  Map<int, bool> seen = {}
  bool empty = true

Look:
  eff:
    seen = merge(seen, look(pscan))
    empty = seen == {}
    atomic:
      known = merge(known, seen)

invariant Mine: forall i: forall c in 0, cells: contains(seen@i, c) implies seen@i[c] == isWall(c)
"""

#: Lists and maps that are made, of parts and of each other.
MADE = """\
def fun longest(int[] a, int[] b) -> int[]: extern

def fun other(Map<int, int> a) -> Map<int, int>: extern

def fun over(Map<int, int> old, Map<int, int> new) -> Map<int, int>:
  Map<int, int> both = old
  for k, v in new:
    both[k] = v
  return both

local:
  int n = 0
  int[] xs = []
  Map<int, int> m = {}

Go:
  eff:
    xs = longest([n, n + 1, 7], xs)
    m = over(other(m), over({n: 1, 3: 2, n + 1: n}, m))
    if length(xs) > 0 and contains(m, n):
      n = xs[0] + m[n]
"""


def outcomes(text: str, *names: str, **settings: Any) -> dict[str, Outcome]:
    report = koord.verify(Source("program.krd", text), jobs=1, timeout_s=60, **settings)
    return {v.name: v.outcome for v in report.verdicts if not names or v.name in names}


# --- what is so of all lists and maps -----------------------------------------------------------


class Interpreted:
    """The oracle that answers with what real lists and maps have."""

    def __init__(self, abstraction: Abstraction, keys: range) -> None:
        self._abstraction = abstraction
        self._keys = keys

    def choose(self, key: Key, low: Any, high: Any, type_: Type) -> Any:
        raise AssertionError("summaries do not choose")

    def external(self, function: core.External, key: Key, arguments: tuple[Any, ...]) -> Any:
        return real(self._abstraction, function, arguments)

    def every(self, type_: Type, body: Callable[[Any], Any]) -> Any:
        assert type_ == INT
        return all(body(key) is True for key in self._keys)

    def vouches_for(self, function: core.External) -> bool:
        return False


def real(abstraction: Abstraction, function: core.External, arguments: tuple[Any, ...]) -> Any:
    """What a function of the abstraction answers about real values."""
    if function.name in abstraction.merges:
        return _merged(*arguments)
    if function.name in abstraction.made:
        assert isinstance(function.result.type, OpaqueType)
        return _of_parts(abstraction.hidden[function.result.type.name], arguments)
    whole, *rest = arguments
    match abstraction.observers[function.name]:
        case Observer.LENGTH:
            return whole.length
        case Observer.ITEM:
            return whole.items[rest[0]] if 0 <= rest[0] < whole.length else 0
        case Observer.HAS:
            return any(key == rest[0] for key, _ in whole.entries)
        case Observer.AT:
            return next((value for key, value in whole.entries if key == rest[0]), 0)


def any_value(type_: Type, abstraction: Abstraction, chance: Random) -> Any:
    if isinstance(type_, OpaqueType):
        type_ = abstraction.hidden[type_.name]
    count = chance.randrange(4)
    if isinstance(type_, ListType):
        items = tuple(any_value(type_.element, abstraction, chance) for _ in range(count))
        return Seq(count, items)
    if isinstance(type_, MapType):
        return _map_of([(chance.randrange(4), chance.randrange(4)) for _ in range(count)])
    return chance.randrange(4)


@pytest.mark.parametrize("text", [MADE, MADE.replace("contains(m, n)", "contains(m, 2)")])
def test_summaries_say_what_is_so_of_real_lists_and_maps(text: str) -> None:
    program = program_of(text)
    abstraction = abstracted(program)
    assert abstraction is not None
    assert abstraction.merges
    assert set(abstraction.observers.values()) == set(Observer)
    system, chance = dealt(abstraction.program, 1), Random(0)
    oracle: Any = Interpreted(abstraction, range(-1, 6))
    said = 0
    for function in abstraction.program.externals:
        if function.name not in abstraction.made | abstraction.observers.keys():
            continue
        for _ in range(60):
            arguments = tuple(any_value(p.type, abstraction, chance) for p in function.parameters)
            if function.name in abstraction.observers:
                arguments = as_called(abstraction, function, arguments)
            answer = real(abstraction, function, arguments)
            m: Any = machine(EXACT, system, oracle)
            m.in_summary = True
            known = [held(EXACT, value) for value in (*arguments, answer)]
            m.memory.bound = [*known, *[None] * (function.bound - len(known))]
            for promise in function.ensures:
                assert statement(m, promise) is True, function.name
                said += 1
            legal = all(statement(m, duty) is True for duty in function.requires)
            assert legal == is_there(abstraction, function, arguments)
    assert said


def as_called(
    abstraction: Abstraction, function: core.External, arguments: tuple[Any, ...]
) -> tuple[Any, ...]:
    """The arguments with the last one as each call has it: no elements, a length, a presence."""
    whole, *rest = arguments
    nothing: Any = Seq(0, ()) if isinstance(whole, Seq) else Table(0, ())
    match abstraction.observers[function.name]:
        case Observer.LENGTH:
            return (whole, nothing)
        case Observer.HAS:
            return (whole, rest[0], nothing)
        case Observer.ITEM:
            return (whole, rest[0] - 1, whole.length)
        case Observer.AT:
            return (whole, rest[0], any(key == rest[0] for key, _ in whole.entries))


def is_there(abstraction: Abstraction, function: core.External, arguments: tuple[Any, ...]) -> bool:
    """Whether what is asked for is there, as the evaluator has it."""
    match abstraction.observers.get(function.name):
        case Observer.ITEM:
            return bool(0 <= arguments[1] < arguments[0].length)
        case Observer.AT:
            return arguments[2] is True
        case _:
            return True


# --- which lists are opaque ---------------------------------------------------------------------


def sorts(text: str) -> set[str]:
    found = abstracted(program_of(text))
    return set(found.hidden) if found is not None else set()


def test_lists_of_which_something_is_done_for_each_element_are_no_opaque_ones() -> None:
    assert sorts(WAYS) == {"pos", "pos[]"}
    count = "    for k = 0, length(way):\n      goal = way[k]\n"
    assert sorts(WAYS.rstrip() + "\n" + count) == {"pos"}
    bounded = "invariant Near: forall i: forall k in 0, length(way@i): way@i[k] == goal@i\n"
    assert sorts(WAYS + bounded) == {"pos"}


def test_maps_that_a_program_writes_to_are_no_opaque_ones() -> None:
    assert "Map<int, bool>" in sorts(MAPS)
    assert "Map<int, bool>" not in sorts(
        MAPS.replace("    empty =", "    seen[2] = true\n    empty =")
    )


def test_merged_maps_may_be_alike_though_their_parts_are_not() -> None:
    found = abstracted(program_of(MADE))
    assert found is not None
    constructs = {e.name for e in found.program.externals if e.constructs}
    assert not constructs & found.merges
    assert not any(
        name.startswith("make Map") and name != "make Map<int, int>()" for name in constructs
    )


# --- verdicts -----------------------------------------------------------------------------------


def test_what_a_planner_promises_of_its_ways_holds_for_every_number_of_robots() -> None:
    """No list is cut off, and the recheck has an argument of its own, with lists of any length."""
    pytest.importorskip("cvc5")
    claim = "invariant Ends: forall i: length(way@i) > 0 implies way@i[length(way@i) - 1] == goal@i"
    report = koord.verify(Source("ways.krd", f"{WAYS}{claim}\n"), jobs=1, timeout_s=60)
    assert all(v.holds and v.engine is Engine.EVERY_N for v in report.verdicts)
    certificate = koord.certify(report)
    assert certificate is not None
    assert koord.recheck(certificate).confirmed
    assert {claim["name"] for claim in certificate.document["claims"]} == {"Ends", "no fault"}


def test_a_way_is_as_long_as_breaks_the_claim() -> None:
    """Longer than any list that was tried before; and it begins and ends where it should."""
    claims = (
        "invariant Short: forall i: length(way@i) < 5\n"
        "invariant Fourth: forall i: length(way@i) > 3 implies way@i[3] == goal@i\n"
        "invariant There: forall i: way@i[0] == goal@i\n"
    )
    found = outcomes(WAYS + claims, robots=1, rounds=2, engine="bmc")
    assert set(found.values()) - {Outcome.HOLDS} == {Outcome.VIOLATED}
    assert all(found[name] is Outcome.VIOLATED for name in ("Short", "Fourth", "There"))


def test_what_maps_say_is_so_where_what_scans_say_is() -> None:
    claims = (
        "invariant Right: forall c in 0, cells: contains(known, c) implies known[c] == isWall(c)\n"
        "invariant Kept: forall i: forall c in 0, cells:\n"
        "  ran(Look)@i and contains(seen@i, c) implies contains(known, c)\n"
    )
    found = outcomes(MAPS + claims, robots=2)
    assert {name for name, outcome in found.items() if outcome is Outcome.HOLDS} >= {
        "Mine",
        "Right",
        "Kept",
    }


def test_maps_have_entries_where_that_breaks_the_claim() -> None:
    claims = (
        "invariant Never: not contains(known, 2)\n"
        "invariant Free: contains(known, 1) implies not known[1]\n"
        "invariant Blank: forall i: empty@i\n"
        "invariant All: forall i: ran(Look)@i implies known[0]\n"
    )
    found = outcomes(MAPS + claims, robots=1, rounds=2, engine="bmc")
    broken = {name for name, outcome in found.items() if outcome is Outcome.VIOLATED}
    assert broken == {"Never", "Free", "Blank", "All"}
