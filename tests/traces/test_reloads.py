"""Traces of runs that go on with another program: their files, and replay across it. [RELOAD]"""

from __future__ import annotations

import io
import json
from pathlib import Path
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

import koord
from koord.api.edits import ListedEdits
from koord.api.fitting import fit, fit_request
from koord.api.outputs import Outputs
from koord.api.sim_report import Simulated
from koord.api.sim_run import SimulationRequest
from koord.api.simulation import simulate_fitted
from koord.api.traces import Trace as Recorded
from koord.api.traces import read_trace
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.semantics.domain import EXACT
from koord.semantics.recordings import Opening, Reached, Recording, execute
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source
from koord.syntax.system import System
from koord.traces.codec import decode, encode
from koord.traces.replay import replay
from koord.traces.trace import Numbers, Sources, Trace, assembled, traced
from koord.traces.unfinished import GrowingTrace, completed
from tests.api.test_story_page import data_of
from tests.generators import runs
from tests.generators.strategies import systems
from tests.sampling import examples
from tests.traces.test_codec import VALID

FIRST = """\
local:
    int own = 0

allwrite:
    int total = 0

Count:
    pre: own < 50
    eff:
        own = own + 1
        stdout << "own" << own
        atomic:
            total = total + 1
"""
SECOND = FIRST.replace("int own = 0", "int own = 0\n    int more = 3")
SECOND = SECOND.replace("int total = 0", "float total = 0.5").replace("total + 1", "total + 0.25")
SECOND = SECOND.replace('"own" << own', '"total" << total')

NO_TEXT = Sources(Source("built.krd", ""))


# --- by the rules ---------------------------------------------------------------------------------


def parted(system: System, recording: Recording, at: int) -> Trace:
    """The run of a recording, with the same program going on after some rounds."""
    rounds = recording.rounds
    first = traced(NO_TEXT, system, Numbers.EXACT, Recording(recording.opening, rounds[:at]))
    rest = Recording(Opening(()), rounds[at:])
    before = Reached(system, first.configurations[-1])
    steps = execute(EXACT, system, rest, before=before)
    return replace(first, later=(assembled(NO_TEXT, system, Numbers.EXACT, rest, steps),))


@given(systems(), st.randoms(use_true_random=False))
@examples(40)
def test_a_run_may_be_parted_anywhere(system: System, random: Random) -> None:
    """Going on with the same program is no change: the parts are legal as the whole is."""
    recording = runs.recording(random, system, 4)
    if recording is None or not recording.rounds:
        return
    whole = traced(NO_TEXT, system, Numbers.EXACT, recording)
    whole_rounds = len(recording.rounds) - recording.rounds[-1].cut
    at = random.randrange(whole_rounds + 1)
    if at == len(recording.rounds) and whole.configurations[-1].fault is not None:
        return
    found = parted(system, recording, at)
    (later,) = found.later
    assert (*found.configurations[:-1], *later.configurations) == whole.configurations
    told = replay(found)
    assert told.refused is None
    assert (told.rounds, told.steps) == (replay(whole).rounds, replay(whole).steps + 1)
    raw = encode(found)
    assert decode(raw, "t.json", lambda sources: system.program) == found


# --- of simulated runs ----------------------------------------------------------------------------


def simulated(path: Path, *edits: tuple[int, str], rounds: int = 8, text: str = FIRST) -> Simulated:
    request = fit_request(Source("counting.krd", text), None, None, 2, 1, None)
    outputs = Outputs(trace=str(path))
    how = SimulationRequest(rounds, edits=ListedEdits(request, edits), outputs=outputs)
    return simulate_fitted(fit(request), how)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The trace of eight rounds, with other programs before the third and the sixth."""
    path = tmp_path_factory.mktemp("reloads") / "trace.json"
    run = simulated(path, (2, SECOND), (5, FIRST))
    assert run.refused is None
    return path


@pytest.fixture(scope="module")
def trace(kept: Path) -> Trace:
    return read_trace(kept.read_bytes(), "trace.json", None)


def test_a_trace_goes_on_with_other_programs(kept: Path, trace: Trace) -> None:
    assert [part.sources.program.text for part in trace.parts] == [FIRST, SECOND, FIRST]
    assert [len(part.recording.rounds) for part in trace.parts] == [2, 3, 3]
    assert [part.configurations[0].round for part in trace.parts] == [0, 2, 5]
    assert json.loads(kept.read_bytes())["version"] == 4
    assert encode(trace) == kept.read_bytes()
    assert next(VALID.iter_errors(json.loads(kept.read_bytes())), None) is None
    report = koord.replay(kept)
    assert (report.legal, report.rounds) == (True, 8)
    assert report.to_dict()["reloads"] == [2, 5]
    assert "reloads" not in koord.replay(Recorded(trace.parts[0])).to_dict()


def test_the_terminal_says_where(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(kept), "--show"]) == Exit.OK
    out = capsys.readouterr().out
    assert "another program goes on before round 3\nstart\n" in out
    assert "round 8, to t = 0.8 s" in out
    assert "another program goes on before rounds 3 and 6" in out


@pytest.mark.parametrize(
    ("old", "new", "rule"),
    [
        ('"more": 3', '"more": 4', "RELOAD"),
        ('"total": 0.5', '"total": 0.75', "RELOAD"),
        ('"own": 1', '"own": 2', "RELOAD"),
    ],
)
def test_what_does_not_go_on_by_the_rule_is_refused(
    kept: Path, old: str, new: str, rule: str
) -> None:
    head, mark, later = kept.read_text("utf-8").partition('"later": [')
    assert old in later
    changed = (head + mark + later.replace(old, new, 1)).encode()
    found = replay(read_trace(changed, "trace.json", None))
    assert found.refused is not None
    assert (found.refused.rule, found.refused.step.round) == (rule, 1)
    assert found.rounds == 2


def test_a_part_that_ends_inside_a_round_is_not_gone_on_from(trace: Trace) -> None:
    *rounds, last = trace.recording.rounds
    cut = Recording(trace.recording.opening, (*rounds, replace(last, cut=True, readings=())))
    program, numbers = trace.sources, trace.numbers
    first = traced(program, trace.system, numbers, cut)
    found = replay(replace(first, later=trace.later))
    assert found.refused is not None
    assert found.refused.rule == "RELOAD"
    assert "between two rounds" in found.refused.reason


def test_claims_of_each_program_are_asked_of_its_part(tmp_path: Path, kept: Path) -> None:
    path = tmp_path / "claimed.json"
    run = simulated(path, (3, FIRST + "\ninvariant Few: total < 2\n"))
    assert [one.claim for one in run.broken] == ["invariant Few"]
    trace = read_trace(path.read_bytes(), "claimed.json", None)
    assert [len(part.recording.rounds) for part in trace.parts] == [3, 0]
    report = koord.replay(koord.load_trace(path), slack=0)
    assert report.broken is not None
    assert (report.broken.name, report.broken.round) == ("Few", 2)
    assert koord.replay(koord.load_trace(kept), slack=0).broken is None


def test_a_fault_of_a_later_program_is_judged(tmp_path: Path) -> None:
    """[FAULT]"""
    path = tmp_path / "faulty.json"
    faulty = FIRST.replace("own = own + 1", "own = own + 1 + 0 * (1 / (3 - own))")
    run = simulated(path, (2, faulty), rounds=30)
    assert run.fault is not None
    assert run.refused is None
    assert koord.replay(path).legal
    assert koord.load_trace(path).rounds == run.figures.rounds + 1


# --- files that grow ------------------------------------------------------------------------------


def until(trace: Trace, rounds: int) -> Trace:
    """The first rounds of a trace; where a program goes on just then, it is there."""
    parts, left = [], rounds
    for part in trace.parts:
        count = min(left, len(part.recording.rounds))
        recording = replace(part.recording, rounds=part.recording.rounds[:count])
        outputs = tuple(one for one in part.outputs if one.round < count)
        configurations = part.configurations[: count + 1]
        parts.append(
            replace(part, recording=recording, configurations=configurations, outputs=outputs)
        )
        left -= count
        if count < len(part.recording.rounds):
            break
    return replace(parts[0], later=tuple(parts[1:]))


def test_files_that_grow_can_be_read_wherever_they_end(trace: Trace) -> None:
    file = io.BytesIO()
    growing = GrowingTrace(file)
    for rounds in range(9):
        growing.grow(until(trace, rounds))
        part = read_trace(file.getvalue(), "part.json", None)
        assert part.cut_off
        assert replace(part, cut_off=False) == until(trace, rounds)
        assert sum(len(one.recording.rounds) for one in part.parts) == rounds
    whole = file.getvalue()
    assert completed(whole, trace) == encode(trace)
    assert encode(trace).startswith(whole[:60])  # also its version, of one digit
    found = set()
    for end in range(whole.index(b"rounds") + 20, len(whole), 37):
        cut = read_trace(whole[:end], "part.json", None)
        assert replay(cut).refused is None
        found.add(tuple(len(part.recording.rounds) for part in cut.parts))
    assert found == {(k,) for k in range(3)} | {(2, k) for k in range(4)} | {
        (2, 3, k) for k in range(3)
    }


# --- where one program is needed ------------------------------------------------------------------


def test_who_needs_one_program_refuses_it(tmp_path: Path, kept: Path) -> None:
    trace = koord.load_trace(kept)
    with pytest.raises(KoordError, match=r"K958.*before round 3.*ITF"):
        trace.to_itf()
    with pytest.raises(KoordError, match="K958"):
        trace.save(tmp_path / "trace.itf.json")
    for found in (trace, koord.replay(kept)):
        with pytest.raises(KoordError, match="K958"):
            koord.story(found)  # it is one story; pages have one for each program
    with pytest.raises(KoordError, match="K958"):
        koord.replay(kept, compiled=True)
    with pytest.raises(KoordError, match="K914"):
        koord.load_trace(kept, program=Source("counting.krd", FIRST))


def test_a_page_has_a_story_for_each_program(tmp_path: Path, kept: Path) -> None:
    trace, page = koord.load_trace(kept), tmp_path / "run.html"
    assert main(["replay", str(kept), "--html", str(page)]) == Exit.OK
    shown = page.read_text("utf-8")
    assert shown == koord.html(koord.replay(kept))
    stories = data_of(shown)["stories"]
    parts = trace.recorded.parts
    assert len(stories) == len(parts) > 1
    behind = 0
    for number, (story, part) in enumerate(zip(stories, parts, strict=True), 1):
        assert story["title"] == f"program {number} of {len(parts)}"
        rounds = sorted({moment["round"] for moment in story["moments"]})
        more = len(part.recording.rounds)
        assert rounds == [0, *range(behind + 1, behind + more + 1)]
        assert story["moments"][0]["rule"] == ("INIT" if number == 1 else "RELOAD")
        assert story["texts"][0]["text"] == part.sources.program.text
        behind += more
    assert stories[0]["ending"]["headline"].startswith("another program goes on behind round")
    assert stories[-1]["ending"]["headline"] == f"the run ends at the end of round {behind}"
