"""What nobody answered accuses nobody: contracts that ask more than robots tell. [EXTERNAL]"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from random import Random
from typing import Any

import pytest
from msgspec import field

import koord
from koord.api.merge import Merged
from koord.refinement.deployed import Expedition, Starts, told_over_network
from koord.refinement.running import ready
from koord.runtime.deploy.member import Untimed
from koord.runtime.robot import Key, Robot, Turn
from koord.syntax.system import dealt
from tests.refinement.part_files import lines_of, write_lines, written
from tests.refinement.running import program, sources
from tests.sampling import first

#: A gap that is read, and functions; of these the program asks two.
WALL = (
    "def fun lit(int x) -> bool: extern\ndef fun seen(int x) -> bool: extern\n"
    "def fun count(int x) -> int: extern\n"
    "using Wall:\n  sensors:\n    int gap\n  contract Near:\n    {clauses}\n"
    "local:\n  int n = 0\n  bool on = false\n"
    "Up:\n  eff:\n    n = count(7)\n    on = lit(3)\n"
)


class Watcher(Untimed):
    """The host of a robot that reads gaps of 0 to 9.

    It answers what the program asks, and otherwise the functions that it ``knows``.
    """

    def __init__(self, pid: int, knows: tuple[str, ...], asked: Counter[str]) -> None:
        self.knows = knows
        self.asked = asked
        self.position = (0.0, 0.0, 0.0)
        self.holding = False
        self._random = Random(pid)

    def start(self, robot: int | None, name: str) -> Any:
        return 0

    def read(self, robot: Robot) -> Mapping[str, Any]:
        return dict.fromkeys(robot.SENSORS, self._random.randrange(10))

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        self.asked[function] += 1
        if turn is Turn.ENV and function not in self.knows:
            raise LookupError(function)
        return 7 if function == "count" else arguments[0] < 9

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        return low


class Watching(Expedition, frozen=True):
    """A run of robots on these hosts."""

    knows: tuple[str, ...] = ()
    asked: Counter[str] = field(default_factory=Counter)

    @property
    def is_seeded(self) -> bool:
        return True

    def host(self, pid: int) -> Any:
        return Watcher(pid, self.knows, self.asked)

    def starts(self) -> Starts:
        return {}


def wall(ensures: str, requires: str = "") -> str:
    clauses = f"ensures: {ensures}"
    return WALL.format(clauses=f"requires: {requires}\n    {clauses}" if requires else clauses)


def parts(folder: Path, text: str, robots: int = 3, rounds: int = 30) -> list[Path]:
    system = dealt(program(text), robots)
    run = Watching(ready(system.program), system, sources(text), rounds, seed=1)
    return written(folder / "parts", system, sources(text), told_over_network(run), "a run")


def judged(folder: Path, text: str, robots: int = 3, rounds: int = 30) -> Merged:
    """The merged run of a program, on which replay agrees."""
    merged = koord.merge(parts(folder, text, robots, rounds))
    merged.trace.save(folder / "run.json")
    assert koord.replay(folder / "run.json").legal is (merged.refused is None)
    return merged


NEAR = "contract Wall.Near"

#: Contracts that answers can meet.
POSSIBLE = [
    "lit(gap')",
    "not seen(gap')",
    "lit(gap') and not seen(gap')",
    "seen(gap') != seen(gap' + 1)",
    "seen(0) or seen(1) and not seen(0)",
    "gap' >= 0 and (gap' == 100 or seen(gap') and seen(gap))",
    "count(gap') == gap' + (count(7) - 7)",
    "count(gap' + 10) == 3 * gap' + 1",
    "count(gap' + 10) > count(gap) - count(gap')",
]


@pytest.mark.parametrize("ensures", first(2, POSSIBLE))
def test_answers_that_nobody_gave_are_chosen_so_that_contracts_hold(
    ensures: str, tmp_path: Path
) -> None:
    merged = judged(tmp_path, wall(ensures))
    assert merged.ok
    assert list(map(str, merged.presumed)) == [NEAR]


@pytest.mark.slow
@pytest.mark.parametrize(("robots", "rounds"), first(1, [(3, 300), (16, 100)]))
def test_so_they_are_in_long_runs(robots: int, rounds: int, tmp_path: Path) -> None:
    ensures = "lit(gap' + 10) and seen(gap') != seen(gap' + 10)"
    merged = judged(tmp_path, wall(ensures), robots, rounds)
    assert merged.ok
    assert merged.trace.rounds == rounds


def test_answers_that_were_chosen_are_changed_for_later_rounds(tmp_path: Path) -> None:
    """Only ``seen(20)`` lets gaps of 9 be, and the library's first choice is true."""
    ensures = "(gap' < 9 or not seen(20)) and (gap' > 0 or seen(21) or seen(20))"
    merged = judged(tmp_path, wall(ensures))
    assert merged.ok
    answers = merged.trace.recorded.recording.rounds[0].answers
    assert {a.value for a in answers if a.arguments == (20,)} <= {False}


IMPOSSIBLE = [
    "gap' > 4",  # by the readings alone
    "gap' > 4 and seen(gap')",
    "seen(gap') and count(gap') > 3 and gap' > 4",
    "seen(gap') and not seen(gap')",
    "seen(20) == (gap' > 4)",  # in no two rounds
    "gap' < 9 or not lit(3)",  # by what a robot told
    "gap' < 9 or count(7) == 8 and seen(gap')",
    "(seen(0) or seen(1)) and not seen(0) and (gap' < 5 or not seen(1))",
]


@pytest.mark.parametrize("ensures", IMPOSSIBLE)
def test_what_is_broken_whatever_the_answers_are_is_told(ensures: str, tmp_path: Path) -> None:
    merged = judged(tmp_path, wall(ensures))
    assert merged.refused is not None
    assert merged.refused.rule == "ENV-CONTRACT"


def test_a_contract_of_readings_alone_is_judged(tmp_path: Path) -> None:
    merged = judged(tmp_path, wall("gap' < 10"))
    assert merged.ok
    assert merged.presumed == ()


def test_so_is_one_that_asks_what_robots_told(tmp_path: Path) -> None:
    merged = judged(tmp_path, wall("lit(3) and count(7) == 7", "gap >= 0 or seen(gap)"))
    assert merged.ok
    assert merged.presumed == ()


def test_where_no_answers_are_found_nobody_is_accused(tmp_path: Path) -> None:
    files = parts(tmp_path, wall("count(gap') * count(gap') == gap' * gap' + 1000003"))
    with pytest.raises(koord.KoordError) as caught:
        koord.merge(files)
    (found,) = caught.value.diagnostics
    assert found.code == "K918"
    assert found.message.startswith(f"nobody answered what {NEAR} asks in round ")


def test_assumptions_hold_as_well_if_they_can(tmp_path: Path) -> None:
    text = wall("gap' < 10") + "assume Dark: forall i: not seen(n@i) and not lit(i + 50)\n"
    merged = judged(tmp_path, text)
    assert merged.ok
    assert list(map(str, merged.presumed)) == ["assumption Dark"]
    text = wall("gap' < 10") + "assume Dark: forall i: seen(n@i) and i < 2\n"
    merged = judged(tmp_path, text)
    assert merged.refused is not None
    assert merged.refused.rule == "PROP-ASSUME"


def test_so_do_summaries(tmp_path: Path) -> None:
    promise = "extern\n  ensures: not seen(x) and count(x + 1) == 5\n"
    text = wall("gap' < 10").replace(
        "lit(int x) -> bool: extern\n", f"lit(int x) -> bool: {promise}"
    )
    assert judged(tmp_path, text).ok
    promise = "extern\n  ensures: seen(x) and not result\n"
    text = wall("gap' < 10").replace(
        "lit(int x) -> bool: extern\n", f"lit(int x) -> bool: {promise}"
    )
    assert judged(tmp_path, text).refused is not None


def test_no_property_is_broken_by_answers_that_nobody_gave(tmp_path: Path) -> None:
    text = wall("not seen(gap')") + "invariant Bright: forall i: seen(Wall.gap@i)\n"
    merged = judged(tmp_path, text)
    assert merged.ok
    assert merged.unjudged == ("Bright",)
    report = koord.replay(tmp_path / "run.json")
    assert (report.broken, report.unjudged) == (None, ("Bright",))


def test_the_contract_of_a_model_is_not_broken_by_them(tmp_path: Path) -> None:
    text = wall("not seen(gap')").replace(
        "  contract", "  environment:\n    gap = gap + 1\n  contract"
    )
    text = text.replace("int gap\n", "int gap = 0\n")
    merged = judged(tmp_path, text)
    assert merged.ok
    assert list(map(str, merged.presumed)) == [NEAR]
    merged = judged(tmp_path, text.replace("not seen(gap')", "not seen(gap') and gap' < 9"))
    assert merged.broken is not None
    assert merged.broken.name == "Near"


def test_a_false_reading_is_still_told(tmp_path: Path) -> None:
    files = parts(tmp_path, wall("gap' < 10 and lit(gap')"))
    lines = lines_of(files[1])
    sensed = [line for line in lines if line["told"] == "sensed"]
    sensed[5]["reading"]["value"] = 77
    write_lines(files[1], lines)
    merged = koord.merge(files)
    assert merged.refused is not None
    assert merged.refused.rule == "ENV-CONTRACT"


def test_they_are_named_in_json(tmp_path: Path) -> None:
    merged = judged(tmp_path, wall("lit(gap')"))
    assert json.loads(merged.to_json())["presumed"] == [{"kind": "contract", "name": "Wall.Near"}]


# --- what contracts ask, and hosts can answer -----------------------------------------------------


def told(
    folder: Path, ensures: str, *knows: str, robots: int = 3, rounds: int = 30
) -> tuple[Merged, Counter[str]]:
    """The merged run of robots on hosts that know these functions, and what these were asked."""
    text = wall(ensures)
    system = dealt(program(text), robots)
    run = Watching(ready(system.program), system, sources(text), rounds, seed=1, knows=knows)
    files = written(folder / "parts", system, sources(text), told_over_network(run), "a run")
    return koord.merge(files), run.asked


def test_a_contract_is_judged_by_what_the_host_answers(tmp_path: Path) -> None:
    merged, _ = told(tmp_path, "lit(gap') or gap' == 9", "lit")
    assert merged.ok
    assert merged.presumed == ()


def test_an_answer_that_breaks_a_contract_is_told(tmp_path: Path) -> None:
    merged, _ = told(tmp_path, "lit(gap')", "lit")
    assert merged.refused is not None
    assert merged.refused.rule == "ENV-CONTRACT"
    assert merged.presumed == ()


def test_a_host_is_asked_once_what_it_cannot_answer(tmp_path: Path) -> None:
    merged, asked = told(tmp_path, "seen(gap') and (lit(gap') or gap' == 9)", "lit")
    assert asked["seen"] == 3
    assert merged.ok
    assert list(map(str, merged.presumed)) == [NEAR]


def test_what_it_answers_counts_where_it_does_not_know_all(tmp_path: Path) -> None:
    merged, _ = told(tmp_path, "seen(gap') and lit(gap')", "lit")
    assert merged.refused is not None


def test_a_contract_asks_once_a_round(tmp_path: Path) -> None:
    rounds = 30
    _, asked = told(tmp_path, "lit(gap') or count(gap) == 7", "lit", "count", rounds=rounds)
    of_contract = asked["lit"] - 3 * rounds  # the program asks as well
    assert 3 * (rounds - 1) <= of_contract <= 3 * rounds


def test_what_is_asked_is_what_the_contract_reads(tmp_path: Path) -> None:
    """Before the environment's turn, and after it, in the round of the reading."""
    merged, _ = told(
        tmp_path, "count(gap') + count(gap) == 14 and lit(gap) == (gap < 9)", "lit", "count"
    )
    assert merged.ok
    assert merged.presumed == ()


def test_robots_tell_what_assumptions_ask_of_themselves(tmp_path: Path) -> None:
    text = wall("gap' < 10") + "assume Few: forall i: count(n@i + i) == 7 and lit(Wall.gap@i)\n"
    system = dealt(program(text), 3)
    of = sources(text)
    for knows, presumed in ((("count", "lit"), []), (("lit",), ["assumption Few"])):
        run = Watching(ready(system.program), system, of, 5, seed=1, knows=knows)
        files = written(tmp_path / knows[0], system, of, told_over_network(run), "a run")
        merged = koord.merge(files)
        assert merged.ok
        assert list(map(str, merged.presumed)) == presumed


def test_an_assumption_that_is_broken_by_an_answer_is_told(tmp_path: Path) -> None:
    text = wall("gap' < 10") + "assume Few: forall i: lit(Wall.gap@i + 7 + i)\n"
    system = dealt(program(text), 3)
    run = Watching(ready(system.program), system, sources(text), 5, seed=1, knows=("lit",))
    files = written(tmp_path / "parts", system, sources(text), told_over_network(run), "a run")
    merged = koord.merge(files)
    assert merged.refused is not None
    assert merged.refused.rule == "PROP-ASSUME"
