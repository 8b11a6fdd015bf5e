"""Forms of slices: whatever is changed in a slice changes its form, and nothing else does."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import pytest
from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.system import System, dealt
from koord.syntax.walk import nodes, rebuilt
from koord.verify.cache.forms import Form, digest
from koord.verify.cache.orders import in_order
from koord.verify.claims import claims_of
from koord.verify.reduction.influence import Matter
from koord.verify.reduction.slicing import Slices
from tests.generators.junk import with_junk
from tests.generators.mutating import mutants
from tests.loading import EXAMPLES, example_files, example_program, program_of
from tests.sampling import first

#: Examples with many parts, of each of which many slices are compared.
LONG = {
    "cars_and_drones",
    "delivery",
    "fischer_drift",
    "fischer_enters",
    "follow_path",
    "mapping",
    "sats",
    "shapeform",
    "takeoff",
    "task",
    "task_as_printed",
    "task_fleet",
}

#: A bit of everything that a slice may be made of.
EVERYTHING = """
enum Colour: red, green
using Motion:
    sensors:
        pos psn
        boolean reached
    actuators:
        pos[] path
    contract OnRoute:
        requires: true
        ensures: onPath(psn', path)
using Tank:
    sensors:
        float level
    actuators:
        boolean open
    environment:
        if open: level = level - choose(0.0, 1.0)
    contract Wet:
        requires: level >= 0.0
        ensures: level' >= -1.0

def fun onPath(pos p, pos[] path) -> bool: extern
    ensures: result or not result
def fun more(int a) -> int:
    return a + 1
local:
    int count = 0
    float wait
    Map<int, bool> seen
    Colour shade = red
allread:
    int[numAgents] mine = 0
allwrite:
    int total = 0
    int[2] board
init:
    count = pid
    Motion.path = [Motion.psn]
urgent Work:
    pre: count < 3 and Tank.level > 0.0
    eff: atomic:
        for i = 0, 2:
            if board[i] == 0: break
        count = more(count)
        total = total + 2
        mine[pid] = count
        shade = green
Rest:
    pre: count >= 3
    eff:
        seen[count] = true
        if contains(seen, 1): trystop()
        else: stop
assume: forall i: wait@i >= 0.0
invariant Few: forall i: count@i <= 5 or shade@i == red
invariant Sum: total >= 0
assume Works: count < 3 leadsto ran(Work)
eventually Done: forall i: stopped@i
"""

#: Fields that mean nothing by themselves, by class.
MEANINGLESS = {
    "Program": {"name", "properties", "parameters", "instance"},
    "Assumption": {"name"},
}

#: Numbers that only tell apart: another that nobody has changes nothing.
TELLING = {"site", "slot", "index"}


def form_of(system: System) -> str:
    """The form of a whole system."""
    everything = frozenset({*Slices(system).everything, Matter.WHOLE_RUNS})
    return Form.of(system, everything).text


def others(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Values that differ from one in one thing, each with where that is."""
    match value:
        case bool():
            yield path, not value
        case Enum() if len(type(value)) > 1:
            members = list(type(value))
            yield path, members[(members.index(value) + 1) % len(members)]
        case int():
            yield path, value + 1
        case Fraction():
            yield path, value + Fraction(1, 7)
        case str():
            yield path, f"{value}x"
        case frozenset():
            yield from ((path, value - {each}) for each in value)
        case tuple():
            for k, part in enumerate(value):
                yield f"{path} without {k}", (*value[:k], *value[k + 1 :])
                for where, other in others(part, f"{path}[{k}]"):
                    yield where, (*value[:k], other, *value[k + 1 :])
        case Struct():
            spared = {"span", *TELLING, *MEANINGLESS.get(type(value).__name__, ())}
            for name in value.__struct_fields__:
                if name not in spared:
                    for where, other in others(getattr(value, name), f"{path}.{name}"):
                        yield where, replace(value, **{name: other})
        case _:
            return


def test_whatever_is_changed_in_a_program_changes_its_form() -> None:
    """Each leaf of its core program, one at a time: no kind of node is left out."""
    system = dealt(program_of(EVERYTHING), 2)
    form, count = form_of(system), 0
    for where, other in others(system.program):
        count += 1
        try:
            changed = form_of(replace(system, program=other))
        except (AssertionError, AttributeError, LookupError, StopIteration, ValueError):
            continue  # there is no such program
        assert changed != form, where
    assert count > 400


@pytest.mark.parametrize(
    "path",
    first(
        2,
        [
            pytest.param(path, marks=[pytest.mark.slow] if path.stem in LONG else [])
            for path in example_files()
            if "broken" not in path.parts
        ],
    ),
    ids=lambda p: p.stem,
)
def test_slices_have_the_same_form_if_their_content_is_the_same(path: Path) -> None:
    """Mistakes change slices, or they do not: the form tells as the programs themselves do."""
    program = example_program(str(path.relative_to(EXAMPLES).with_suffix("")))
    system = dealt(program, 2)
    slices = Slices(system)
    cones = {claim.name: slices.cone([claim]) for claim in claims_of(system)}
    made = list(mutants(program))
    same = different = 0
    for mutant in Random(0).sample(made, min(15, len(made))):
        changed = Slices(dealt(mutant.program, 2))
        for claim in claims_of(system):
            cone, other = cones[claim.name], changed.cone([claim])
            if slices.extent(cone) != changed.extent(other):
                continue
            parts = slices.slice_of(cone), changed.slice_of(other)
            inside = [frozenset(c) for c in (cone, other)]
            forms = [Form.of(part, each).text for part, each in zip(parts, inside, strict=True)]
            is_same = bare(parts[0].program) == bare(parts[1].program)
            assert (forms[0] == forms[1]) == is_same, (str(mutant), claim.name)
            same, different = same + is_same, different + (not is_same)
    assert different > 0


def bare(program: core.Program) -> core.Program:
    """A program without what its form leaves out, and in its order."""
    left = replace(program, name="", properties=(), parameters=(), expectations=())
    return in_order(left)


@pytest.mark.parametrize("name", ["task", "sats", "fischer", "leader_elect", "cars_and_drones"])
def test_what_no_claim_depends_on_changes_no_form(name: str) -> None:
    """Variables, ports, statements, locks and events of junk, which are added everywhere."""
    system = dealt(example_program(name), 3)
    junked = with_junk(system, Random(1))
    claims = claims_of(system)
    before, after = Slices(system), Slices(junked)
    for claim in claims:
        forms = []
        for slices in (before, after):
            cone = slices.cone([claim])
            forms.append(Form.of(slices.slice_of(cone), cone))
        if before.slice_of(before.cone([claim])) is not before.system:
            assert forms[0].text == forms[1].text
        assert forms[0].claim(claim) == forms[1].claim(claim)


def test_places_and_comments_are_no_part_of_a_form() -> None:
    moved = "# a comment\n\n" + EVERYTHING.replace("init:", "# another\ninit:")
    assert form_of(dealt(program_of(EVERYTHING), 2)) == form_of(dealt(program_of(moved), 2))


def test_numbers_of_calls_only_tell_them_apart() -> None:
    text = (
        "local:\n    int x = 0\n    int y = 0\ninit:\n    x = choose(0, 1)\n    y = choose(0, 1)\n"
    )
    system = dealt(program_of(text), 2)
    calls = {node.site for node in _choices(system.program)}
    assert len(calls) == 2
    one = _renumbered(system.program, dict.fromkeys(calls, 7))
    others_ = _renumbered(system.program, {site: site + 10 for site in calls})
    assert form_of(replace(system, program=others_)) == form_of(system)
    assert form_of(replace(system, program=one)) != form_of(system)


def _choices(program: core.Program) -> list[core.Choose]:
    return [node for node in nodes(program) if isinstance(node, core.Choose)]


def _renumbered(node: Any, sites: dict[int, int]) -> Any:
    if isinstance(node, core.Choose):
        node = replace(node, site=sites[node.site])
    return rebuilt(node, lambda part: _renumbered(part, sites))


def test_robots_and_rounds_are_part_of_a_form() -> None:
    program = program_of(EVERYTHING)
    forms = {
        form_of(dealt(program, 2)),
        form_of(dealt(program, 3)),
        form_of(dealt(program, 2, Fraction(1, 7))),
    }
    assert len(forms) == 3


def test_texts_of_a_digest_are_told_apart() -> None:
    assert digest("a", "bc") != digest("ab", "c")
    assert digest("a") != digest("a", "")
