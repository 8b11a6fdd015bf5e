"""Merging parts of deployed runs, from Python: in virtual time, so that runs repeat."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

import pytest

import koord
from koord.api.merge import Merged, PartEnd
from koord.runtime.chaos.network import CALM, CHAOS, Faults
from tests.refinement.part_files import Line, lines_of, part_files, write_lines
from tests.sampling import first

EXAMPLES = Path(__file__).resolve().parents[2] / "specs/examples"

COUNT = (
    "allwrite:\n  int sum = 0\nlocal:\n  int mine = 0\n"
    "Add:\n  eff:\n    atomic:\n      sum = sum + 1\n    mine = sum\n    stdout << mine\n"
)

#: Values of many types, some of them large, output, choices, an urgent event, a fault.
PROGRAMS = {
    "count": COUNT,
    "large": 'local:\n  int n = 7\n  float[] xs\n  string word = "ä"\n'
    "Up:\n  eff:\n    n = n * n + 2\n    xs.append(0.1 * pid)\n    stdout << n << xs << word\n",
    "chosen": "def fun noise(int most) -> int: extern fresh\n"
    "  ensures: 0 <= result and result <= most\n"
    "using Wall:\n  sensors:\n    int gap\n    bool near\n  contract Near:\n"
    "    ensures: near' == (gap' < 4)\nlocal:\n  int n\ninit:\n  n = choose(0, 9)\n"
    "Draw:\n  eff:\n    n = noise(9)\n    stdout << n << Wall.gap << Wall.near\n",
    "urgent": "local:\n  int n = 0\nurgent Up:\n  pre: n < 9\n  eff:\n    n = n + 1\n",
    "faulty": "local:\n  int n = 0\nUp:\n  eff:\n    n = n + 1\n    n = n + 6 / (5 - n)\n",
    "modelled": "using Wall:\n  sensors:\n    int gap = 30\n  environment:\n"
    "    gap = choose(gap - 1, gap + 1)\nlocal:\n  int n = 0\nUp:\n  eff:\n    n = Wall.gap\n",
}


#: A program in which robots see what others have sensed.
SHARED = "allwrite:\n  int seen = 0\n" + PROGRAMS["modelled"].replace("n = Wall", "seen = Wall")


def error(files: list[Path]) -> koord.Diagnostic:
    with pytest.raises(koord.KoordError) as caught:
        koord.merge(files)
    (found,) = caught.value.diagnostics
    return found


def example(name: str) -> str:
    return (EXAMPLES / f"{name}.krd").read_text("utf-8")


# --- what is whole --------------------------------------------------------------------------------


@pytest.mark.parametrize("faults", [CALM, CHAOS], ids=["calm", "chaos"])
@pytest.mark.parametrize("name", PROGRAMS)
def test_parts_make_a_trace_that_is_legal(name: str, faults: Faults, tmp_path: Path) -> None:
    files = part_files(tmp_path, PROGRAMS[name], faults=faults)
    merged = koord.merge(files)
    assert merged.ok
    assert [part.end for part in merged.parts] == [PartEnd.LEFT] * 3
    merged.trace.save(tmp_path / "run.json")
    report = koord.replay(tmp_path / "run.json")
    assert report.legal
    assert report.rounds == merged.trace.rounds == merged.rounds_told
    assert json.loads(merged.to_json())["refused"] is None
    assert "legal" in repr(merged)
    assert "<td>left</td>" in merged._repr_html_()


@pytest.mark.parametrize("name", ["task", "leader_elect", "sum_of_ids", "cars_and_drones"])
def test_parts_of_examples_do(name: str, tmp_path: Path) -> None:
    merged = koord.merge(part_files(tmp_path, example(name), robots=4, rounds=20, faults=CHAOS))
    assert merged.ok
    assert merged.trace.rounds == 20


def test_output_is_in_the_trace(tmp_path: Path) -> None:
    merged = koord.merge(part_files(tmp_path, COUNT))
    outputs = [one.written.values for one in merged.trace.recorded.outputs]
    assert outputs == [(k + 1,) for k in range(12)]


def test_a_fault_is_in_the_trace(tmp_path: Path) -> None:
    merged = koord.merge(part_files(tmp_path, PROGRAMS["faulty"]))
    fault = merged.trace.recorded.configurations[-1].fault
    assert fault is not None
    assert merged.ok


def test_the_fault_of_a_model_is_the_end_of_the_whole_run(tmp_path: Path) -> None:
    """[FAULT]: nobody runs in the round before which a model faulted, so it is no round."""
    text = PROGRAMS["modelled"].replace("gap = choose(gap - 1, gap + 1)", "gap = gap - gap / gap")
    merged = koord.merge(part_files(tmp_path, text, rounds=40))
    assert merged.trace.recorded.configurations[-1].fault is not None
    assert merged.rounds_told == merged.trace.rounds < 40
    assert merged.ok


def test_parts_come_in_any_order_and_some_twice(tmp_path: Path) -> None:
    files = part_files(tmp_path, COUNT)
    copy = tmp_path / "copy.jsonl"
    copy.write_bytes(b"".join(files[1].read_bytes().splitlines(keepends=True)[:9]))
    merged = koord.merge([files[2], copy, files[0], files[1]])
    assert merged.trace.encoded() == koord.merge(files).trace.encoded()


# --- what is missing ------------------------------------------------------------------------------


def with_gap(file: Path, gap: Callable[[Line], bool]) -> None:
    """Let a part be as if the disk had been full for these lines, all of which are neighbours."""
    lines = lines_of(file)
    lost = [n for n, line in enumerate(lines) if gap(line)]
    assert lost == list(range(lost[0], lost[-1] + 1))
    lines[lost[0] : lost[-1] + 1] = [{"told": "missed", "reports": len(lost)}]
    write_lines(file, lines)


def test_of_reports_that_could_not_be_written_the_others_tell(tmp_path: Path) -> None:
    files = part_files(tmp_path, COUNT)
    with_gap(files[1], lambda line: 3 <= line.get("round", -1) < 6)
    merged = koord.merge(files)
    assert merged.refused is None
    assert merged.trace.rounds == 12
    assert [part.missed > 0 for part in merged.parts] == [False, True, False]
    assert not merged.is_whole


def test_nobody_is_accused_of_what_could_not_be_written(tmp_path: Path) -> None:
    files = part_files(tmp_path, PROGRAMS["chosen"])
    answered = next(
        one for one in lines_of(files[1]) if one["told"] == "answered" and one["round"] > 3
    )
    with_gap(files[1], lambda line: line["n"] == answered["n"])
    found = error(files)
    assert found.code == "K918"
    assert found.message.startswith("what robots 1 did cannot be filled in: in round")


def test_of_a_robot_without_a_part_the_others_tell(tmp_path: Path) -> None:
    files = part_files(tmp_path, COUNT)
    merged = koord.merge(files[:1])
    assert merged.missing == (1, 2)
    assert not merged.is_whole
    assert merged.refused is None
    assert merged.trace.encoded() == koord.merge(files).trace.encoded()


def test_what_only_a_missing_robot_sensed_cannot_be_filled_in(tmp_path: Path) -> None:
    files = part_files(tmp_path, SHARED)
    told = error(files[:2])
    assert told.code == "K918"
    assert told.message.startswith("what robots 2 did cannot be filled in: ")
    assert told.hint == "name the parts of the robots 2 as well"


def test_nor_can_what_a_robot_sensed_that_was_ended_without_telling(tmp_path: Path) -> None:
    files = part_files(tmp_path, SHARED)
    lines = lines_of(files[2])
    write_lines(files[2], [one for one in lines if one.get("round", -1) < 3])
    told = error(files)
    assert told.message.startswith("what robots 2 did cannot be filled in: ")
    assert told.hint is None


def test_nor_can_how_a_missing_robot_began(tmp_path: Path) -> None:
    """[PROP-ASSUME]: what it began with is not known, and is no violation."""
    text = "local:\n  int x\nUp:\n  eff:\n    x = x + 1\nassume: forall i: x@i == 3\n"
    files = part_files(tmp_path, text)
    assert koord.merge(files).ok
    assert error(files[:2]).message.startswith("what robots 2 did cannot be filled in: ")


@pytest.mark.parametrize("part", range(3))
def test_a_part_may_end_in_the_middle_of_a_line(part: int, tmp_path: Path) -> None:
    files = part_files(tmp_path, COUNT)
    whole = koord.merge(files).trace.encoded()
    raw = files[part].read_bytes()
    files[part].write_bytes(raw[: 2 * len(raw) // 3])
    merged = koord.merge(files)
    assert merged.parts[part].end is PartEnd.TORN
    assert merged.parts[part].rounds < 12
    assert merged.trace.encoded() == whole


def test_rounds_that_nobody_tells_of_end_the_trace(tmp_path: Path) -> None:
    (file,) = part_files(tmp_path, COUNT, robots=1)
    lines = [one for one in lines_of(file) if (one["told"], one.get("round")) != ("acted", 4)]
    write_lines(file, lines)
    merged = koord.merge([file])
    assert (merged.trace.rounds, merged.rounds_told, merged.is_whole) == (4, 12, False)


def test_a_last_round_after_which_nobody_looked_is_cut(tmp_path: Path) -> None:
    """Robots that were all killed: what was decided and written in it is in the trace."""
    files = part_files(tmp_path, COUNT)
    for file in files:
        lines = lines_of(file)
        write_lines(file, [one for one in lines if one["told"] != "left" and _before(one, 12)])
    merged = koord.merge(files)
    rounds = merged.trace.recorded.recording.rounds
    assert [round_.cut for round_ in rounds] == [False] * 11 + [True]
    assert len(merged.trace.recorded.outputs) == 12
    assert merged.is_whole
    assert koord.replay(merged.trace).legal


def _before(line: Line, round_: int) -> bool:
    return not (line["told"] == "stood" and line["round"] >= round_)


def test_without_a_beginning_there_is_no_run(tmp_path: Path) -> None:
    (file,) = part_files(tmp_path, COUNT, robots=1)
    write_lines(file, lines_of(file)[:1])
    assert error([file]).message == "no part tells how the run began"
    (file,) = part_files(tmp_path / "late", COUNT, robots=1)
    lines = [one for one in lines_of(file) if (one["told"], one.get("round")) != ("acted", -1)]
    write_lines(file, lines)
    assert error([file]).message == "no part tells how the run began"
    with pytest.raises(koord.ArgumentError, match="no part to merge"):
        koord.merge([])


# --- what does not belong together ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"run": "another"}, "the run 'another' is not 'a run'"),
        ({"params": {"n": {"int": "3"}}}, "the param n differs"),
        ({"delta": "1/5"}, "δ = 0.2 s is not 0.1 s"),
        ({"tasks": [["1", "2", "3"]]}, "the tasks differ"),
        ({"robots": [0, 0, 0, 0]}, "the robots differ, or their kinds"),
        ({"slack": "1/100"}, "the slack differs"),
    ],
)
def test_parts_of_different_runs_are_refused(change: Line, said: str, tmp_path: Path) -> None:
    files = part_files(tmp_path, f"param int n = 4\n{COUNT}")
    head, *rest = lines_of(files[1])
    write_lines(files[1], [head | change, *rest])
    found = error([files[1], files[0]])
    assert found.code == "K918"
    assert found.message == f"it does not belong to {files[1]}: {said}"


def test_two_parts_of_a_robot_are_refused(tmp_path: Path) -> None:
    one = part_files(tmp_path / "one", COUNT)
    other = part_files(tmp_path / "other", COUNT, faults=CHAOS)
    found = error([*one, other[2]])
    assert found.code == "K918"
    assert found.message.endswith(": these are two parts of robot 2, which differ")


def test_a_robot_tells_of_itself_alone(tmp_path: Path) -> None:
    files = part_files(tmp_path, COUNT)
    head, *rest = lines_of(files[1])
    write_lines(files[1], [head | {"pid": 0}, *rest])
    found = error(files)
    assert (found.code, found.message[-33:]) == ("K913", "it is told by robot 0, of robot 1")


def test_parts_of_another_program_are_refused(tmp_path: Path) -> None:
    one = part_files(tmp_path / "one", COUNT)
    other = part_files(tmp_path / "other", COUNT.replace("+ 1", "+ 2"))
    assert error([one[0], other[1]]).message.endswith("the program differs")


def test_the_same_program_may_be_laid_out_differently(tmp_path: Path) -> None:
    one = part_files(tmp_path / "one", COUNT)
    other = part_files(tmp_path / "other", COUNT.replace("local:", "# its own\nlocal:"))
    merged = koord.merge([one[0], other[1], other[2]])
    assert merged.ok


def test_robots_that_acted_on_different_decisions_are_named(tmp_path: Path) -> None:
    """(I-AGREE)"""
    files = part_files(tmp_path, COUNT)
    lines = lines_of(files[2])
    (acted,) = [one for one in lines if (one["told"], one.get("round")) == ("acted", 4)]
    acted["skipped"].reverse()
    write_lines(files[2], lines)
    found = error(files)
    assert found.code == "K919"
    assert found.message == "robots 0 and 2 acted on different decisions in round 5"
    assert found.span.file == f"{files[0]} and {files[2]}"


# --- mutated parts --------------------------------------------------------------------------------

Mutation = Callable[[list[list[Line]], Random], str]


def _some(parts: list[list[Line]], rng: Random, *told: str) -> tuple[list[Line], int]:
    """A line of any part that tells of one of these, but for the head."""
    places = [
        (part, n)
        for part in parts
        for n, line in enumerate(part)
        if n and (not told or line["told"] in told)
    ]
    return rng.choice(places)


def dropped_line(parts: list[list[Line]], rng: Random) -> str:
    part, n = _some(parts, rng)
    return f"dropped {part.pop(n)['told']}"


def line_twice(parts: list[list[Line]], rng: Random) -> str:
    part, n = _some(parts, rng)
    part.insert(rng.randrange(n, len(part)) + 1, part[n])
    return f"twice {part[n]['told']}"


def exchanged_lines(parts: list[list[Line]], rng: Random) -> str:
    part, n = _some(parts, rng)
    other = rng.randrange(1, len(part))
    part[n], part[other] = part[other], part[n]
    return f"exchanged {part[n]['told']} and {part[other]['told']}"


def cut_part(parts: list[list[Line]], rng: Random) -> str:
    part, n = _some(parts, rng)
    del part[n:]
    return "cut"


def changed_decision(parts: list[list[Line]], rng: Random) -> str:
    part, n = _some(parts, rng, "acted")
    line = json.loads(json.dumps(part[n]))
    part[n] = line
    match rng.randrange(5):
        case 0:
            line["ran"].reverse()
            line["skipped"].reverse()
        case 1 if line["ran"]:
            line["skipped"].append(line["ran"].pop()["robot"])
        case 2 if line["ran"]:
            line["ran"][0]["robot"] = (line["ran"][0]["robot"] + 1) % len(parts)
        case 3:
            line["round"] += rng.choice((-1, 1))
        case _:
            line["digest"] = line["digest"][::-1]
    return "decision"


def swapped_pid(parts: list[list[Line]], rng: Random) -> str:
    one, other = rng.sample(parts, 2)
    one[0], other[0] = other[0] | {"n": 0}, one[0] | {"n": 0}
    return "swapped pid"


def _leaves(value: Any) -> Iterator[tuple[Any, Any]]:
    """The scalars in a line, each as what holds it and where."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, item in items:
        if isinstance(item, dict | list):
            yield from _leaves(item)
        elif key not in ("told", "n"):
            yield value, key


def changed_value(parts: list[list[Line]], rng: Random) -> str:
    part, n = _some(parts, rng)
    line = json.loads(json.dumps(part[n]))
    part[n] = line
    leaves = list(_leaves(line))
    if not leaves:
        return "nothing"
    held, key = rng.choice(leaves)
    match held[key]:
        case bool():
            held[key] = not held[key]
        case int() | float():
            held[key] += rng.choice((-1, 1))
        case str():
            held[key] = rng.choice(("", held[key] + "x", held[key][::-1]))
        case None:
            held[key] = 0
    return f"value of {line['told']}"


#: Of lines as such, of which the numbers of lines tell, too; and of what they say.
OF_LINES: tuple[Mutation, ...] = (dropped_line, line_twice, exchanged_lines)
MUTATIONS: tuple[Mutation, ...] = (
    *OF_LINES,
    cut_part,
    changed_decision,
    swapped_pid,
    changed_value,
    changed_value,
)

#: The runs that are mutated: with output and a lock, with choices and models, with a fault; calm
#: and in chaos, with robots that crash and come back.
RUNS = (("count", CHAOS), ("chosen", CALM), ("modelled", CHAOS), ("faulty", CALM))


def merged_or_refused(files: list[Path]) -> Merged | None:
    """None: parts that were refused by name, never by an exception of ours."""
    try:
        return koord.merge(files)
    except koord.KoordError:
        return None


@pytest.mark.parametrize(("name", "faults"), first(1, RUNS), ids=[name for name, _ in RUNS])
def test_mutated_parts_are_refused_or_judged_or_harmless(
    name: str, faults: Faults, tmp_path: Path
) -> None:
    """Of each mutation that nobody notices the trace is one that the rules allow, of the same
    schedule, states and output: what was changed is told by others, too, or has no effect.
    """
    files = part_files(tmp_path, PROGRAMS[name], faults=faults)
    whole = koord.merge(files)
    honest = whole.trace.recorded
    original = [lines_of(file) for file in files]
    fates: Counter[str] = Counter()
    for seed in range(80):
        rng, mutation = Random(seed), MUTATIONS[seed % len(MUTATIONS)]
        parts = [list(lines) for lines in original]
        what = mutation(parts, rng)
        if parts == original:
            continue
        if mutation in OF_LINES:  # as somebody leaves them who does not count
            put_down(files, parts, number=False)
            found = merged_or_refused(files)
            assert found is None or what == "dropped left", what  # the last line of a part
            assert found is None or found.to_dict() != whole.to_dict()
            fates["refused" if found is None else "told"] += 1
        put_down(files, parts, number=mutation in OF_LINES)
        merged = merged_or_refused(files)
        if merged is None:
            fates["refused"] += 1
        elif merged.refused is not None:
            fates["judged"] += 1
        elif merged.to_dict() != whole.to_dict():
            fates["told"] += 1  # rounds are missing, or a part does not end as it should
        else:
            fates["harmless"] += 1
            recorded = merged.trace.recorded
            assert repr(recorded.configurations) == repr(honest.configurations), what
            assert repr(recorded.outputs) == repr(honest.outputs), what
            assert schedule(merged) == schedule(whole), what
    print(name, dict(fates))
    assert fates.total() > 100
    assert fates["refused"] + fates["judged"] + fates["told"] > 2 * fates["harmless"]


def put_down(files: list[Path], parts: list[list[Line]], *, number: bool) -> None:
    for file, lines in zip(files, parts, strict=True):
        write_lines(file, lines, number=number)


def schedule(merged: Merged) -> list[object]:
    recording = merged.trace.recorded.recording
    return [recording.opening.order, *((r.order, r.events, r.cut) for r in recording.rounds)]


# --- what is claimed ------------------------------------------------------------------------------


def test_the_first_property_that_a_run_breaks_is_told(tmp_path: Path) -> None:
    """[PROP-INVARIANT]: the trace goes on to the end of the run, and replay tells of it as well."""
    text = f"{COUNT}invariant Small: sum < 5\ninvariant Tiny: sum < 9\n"
    merged = koord.merge(part_files(tmp_path, text))
    assert merged.refused is None
    assert not merged.ok
    assert merged.broken is not None
    assert (merged.broken.name, merged.broken.round) == ("Small", 4)
    assert merged.trace.rounds == 12
    assert "breaks Small" in repr(merged)
    report = koord.replay(merged.trace)
    assert report.legal
    assert report.broken == merged.broken
    assert "breaks Small" in repr(report)


def test_a_contract_that_a_model_breaks_is_told(tmp_path: Path) -> None:
    """[PROP-CONTRACT]"""
    text = PROGRAMS["modelled"].replace(
        "  environment:", "  contract Near:\n    ensures: gap' == gap\n  environment:"
    )
    merged = koord.merge(part_files(tmp_path, text))
    assert merged.broken is not None
    assert merged.broken.name == "Near"


def test_a_property_that_asks_what_nobody_answered_is_not_judged(tmp_path: Path) -> None:
    asking = "def fun odd(int n) -> bool: extern\n" + COUNT + "invariant Odd: odd(sum)\n"
    merged = koord.merge(part_files(tmp_path, f"{asking}invariant Small: sum < 5\n"))
    assert merged.unjudged == ("Odd",)
    assert merged.broken is not None
    assert koord.replay(merged.trace).unjudged == ("Odd",)
