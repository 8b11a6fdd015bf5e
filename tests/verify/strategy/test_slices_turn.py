"""What no claim can depend on costs nothing, and changes no verdict. [T-CONE]"""

from __future__ import annotations

from pathlib import Path

import pytest

from koord.cli.main import main
from koord.sampling import run_extension
from koord.sampling.run_extension import extended
from koord.sampling.values import Sampler
from koord.semantics.recordings import Recording
from koord.verify.engine_names import Engine
from koord.verify.verdicts import Outcome
from tests.sampling import first
from tests.verify.asking import ask, of_text

JUNK = """
using Unread:
    sensors:
        pos psn
        int level
"""

COUNTS = """
local:
    int x = 0
    int y = 0
Up:
    pre: x < 6
    eff: x = x + 2
Down:
    pre: x > 3 and y < 4
    eff:
        y = y + 1
        x = x - 1
invariant Sum: forall i: x@i + y@i != 8
invariant Small: forall i: x@i < 8
"""


def told(
    text: str, choice: Engine | None, rounds: int = 8
) -> dict[str, tuple[Outcome, int | None]]:
    """What is said of each claim, with the round in which it breaks."""
    return {
        v.claim.name: (v.outcome, v.rounds if v.counterexample is None else v.counterexample.round)
        for v in ask(of_text(text), rounds=rounds, choice=choice)
    }


@pytest.mark.parametrize("choice", [None, Engine.SEARCH, Engine.BMC, Engine.BITS])
def test_what_nobody_reads_changes_no_verdict(choice: Engine | None) -> None:
    """A sensor that reads real numbers makes infinitely many configurations of few."""
    plain = told(COUNTS, choice)
    assert plain["Sum"] == (Outcome.VIOLATED, 5)
    assert told(JUNK + COUNTS, choice) == plain


def test_a_search_sees_all_of_a_slice_though_others_count_for_ever() -> None:
    text = COUNTS.replace("Up:", "    int n = 0\nCount:\n    pre: true\n    eff: n = n + 1\nUp:")
    text += "invariant Counted: forall i: n@i >= 0\n"
    said = ask(of_text(text), rounds=8)
    assert said.outcome("Counted") is Outcome.HOLDS
    assert (said["Sum"].outcome, said["Sum"].engine) == (Outcome.VIOLATED, Engine.SEARCH)


FAULTS = """
local:
    int x = 0
    int z = 0
E:
    pre: true
    eff:
        z = 1 / x
        x = 1
invariant Zero: forall i: x@i == 0
"""


@pytest.mark.parametrize("choice", [None, Engine.SEARCH, Engine.BMC])
def test_what_only_a_slice_breaks_is_not_broken(choice: Engine | None) -> None:
    """Without the division x becomes 1; with it no run goes on."""
    said = told(FAULTS, choice)
    assert said["Zero"][0] is Outcome.HOLDS
    assert said["no fault"] == (Outcome.VIOLATED, 1)


BLOCKS = """
using Eyes:
    sensors:
        int seen
        int other
    contract K:
        requires: other >= 0
        ensures: other' > 3 and other' < 3
local:
    int x = 0
assume: forall i: Eyes.other@i == 0
E:
    pre: true
    eff: x = x + 1
invariant Once: forall i: x@i < 2
"""


def test_what_contracts_do_not_let_happen_is_not_violated() -> None:
    """The slice has no contract and breaks the claim; so the whole program is asked."""
    assert told(BLOCKS, Engine.BMC, 3)["Once"] == (Outcome.HOLDS, 3)


def test_readings_are_made_up_that_contracts_allow() -> None:
    text = BLOCKS.replace("other' > 3 and other' < 3", "other' > 40 and other' < 42")
    (once, _) = ask(of_text(text), rounds=4)
    assert once.counterexample is not None
    (first, *_) = once.counterexample.recording.rounds
    assert [r.value for r in first.readings if r.slot == 1] == [41, 41]


HISTORY = """
local:
    int x = 0
    int before = 0
E:
    pre: x < 100000
    eff:
        before = x
        x = 2 * x + 4
invariant Even: forall i: x@i != 7
invariant Twice: forall i: x@i == 0 or x@i == 2 * before@i + 4
"""


def test_invariants_about_more_than_a_slice_help_with_its_claims() -> None:
    """A history variable that no event reads: without it nothing is known of x."""
    for name in ("Even", "Twice"):
        verdict = ask(of_text(HISTORY), choice=Engine.INDUCTION)[name]
        assert (verdict.outcome, verdict.rounds) == (Outcome.HOLDS, None)


LOOPS = """
local:
    int x = 0
    int n = 0
    int[] log = []
E:
    pre: x < 3
    eff:
        x = 0
        %s
eventually Done: forall i: x@i == 3
"""


@pytest.mark.parametrize("choice", [None, Engine.SEARCH, Engine.BITS])
def test_a_loop_need_not_come_back_to_what_nothing_depends_on(choice: Engine | None) -> None:
    plain = told(LOOPS % "x = 0", choice, 4)
    assert plain["Done"] == (Outcome.VIOLATED, 1)
    assert told(JUNK + LOOPS % "n = n + 1", choice, 4) == plain


@pytest.mark.parametrize("choice", [Engine.SEARCH, Engine.BITS])
def test_a_lasso_of_a_slice_that_is_none_of_the_program_is_not_shown(choice: Engine | None) -> None:
    """The branch makes the program remember n: the loop is one round later."""
    text = LOOPS % "if n == 0: log = [n]\n        n = 1"
    assert told(text, choice, 4)["Done"] == (Outcome.VIOLATED, 2)
    # A fault ends each run, so there is none without end.
    assert told(LOOPS % "n = 1 / n", choice, 4)["Done"][0] is Outcome.HOLDS


@pytest.mark.parametrize("choice", first(1, [Engine.BMC, None]))
def test_starts_that_contradictory_assumptions_want_are_looked_for_once(
    choice: Engine | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[Sampler] = []

    def counted(recording: Recording, sampler: Sampler) -> Recording:
        tried.append(sampler)
        return extended(recording, sampler)

    monkeypatch.setattr(run_extension, "extended", counted)
    text = COUNTS.replace("local:", "local:\n    int a\n    int b")
    text += "assume: forall i: a@i > 5 and b@i > a@i\nassume: forall i: b@i < a@i\n"
    assert told(text, choice)["Sum"][0] is Outcome.HOLDS
    slices = {id(sampler.system) for sampler in tried}
    assert 0 < len(tried) <= 4 * 2 * max(1, len(slices))
    assert all((sampler.start_tries or 10_000) <= 100 for sampler in tried)


def test_what_a_claim_does_not_depend_on_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "counts.krd"
    path.write_text(JUNK + COUNTS)
    main(["verify", "--explain", "--robots", "1", str(path)])
    shown = capsys.readouterr().out
    assert "Sum does not depend on sensor Unread.level, sensor Unread.psn." in shown
