"""Who waits in the order of numbers enters, for every number of robots. [T-PROGRESS]

The proof agrees with a search, where numbers are bounded; where robots overtake for ever, or nobody
leaves, the search shows it with few robots, and no proof may be found.
"""

from __future__ import annotations

from fractions import Fraction

import pytest

from koord.syntax.system import System, dealt
from koord.verify.claims import Claim, ClaimKind, liveness_of
from koord.verify.effort import Deadline, Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.every_n.progress import ProgressProof, progress
from koord.verify.engines.every_n.progress_least import least_of, read_by
from koord.verify.engines.every_n.progress_parts import help_of
from koord.verify.engines.every_n.questions import GENEROUS, Means
from koord.verify.strategy import verification
from koord.verify.verdicts import Bounds, Outcome, Report
from tests.loading import program_of, protocol_text
from tests.sampling import but_slow, first
from tests.verify.asking import system_of

#: What is known of the numbers.
KNOWN = """
invariant Behind: forall me, i:
    phase[me] == waiting and phase[i] == critical implies mine@i <= number[me]
invariant Shown: forall i: phase[i] != drawing implies mine@i == number[i]
invariant Least: forall i, j:
    i != j and phase[i] != waiting and mine@j != 0 implies number[i] <= mine@j
invariant Drawn: forall i: phase[i] == waiting or phase[i] == critical implies mine@i != 0
invariant Gone: forall i: phase[i] == out implies mine@i == 0
invariant Natural: forall i: 0 <= number[i] and number[i] <= mine@i
"""

BAKERY = protocol_text("bakery")

#: Robots draw no numbers as long as there is a great one, so that a search ends;
#: with ``MORE`` some draw one while others wait.
FEW, MORE = (
    BAKERY.replace("pre: phase[pid] == out", f"pre: phase[pid] == out and greatest(number) < {k}")
    for k in (1, 2)
)

#: Variants in which somebody who waits may wait for ever.
UNFAIR = {
    "numbers are no turns": (BAKERY, "greatest(number) + 1", "1"),
    "nobody leaves": (FEW, "pre: phase[pid] == critical", "pre: phase[pid] == critical and false"),
    "the last goes first": (MORE, "numbers[k] < numbers[who]", "numbers[k] > numbers[who]"),
}

#: Always somebody is ready, and nobody for long.
FLIPPED = """
allwrite:
    bool zero = true
local:
    bool done = false
Do:
    pre: not done and (zero == (pid == 0) or numAgents == 1)
    eff:
        done = true
Flip:
    pre: numAgents > 1 and zero != (pid == 0)
    eff:
        zero = not zero
eventually Done: exists i: done@i
"""


def proof_of(text: str, seed: int = 0) -> ProgressProof | str:
    """A proof of the last claim about whole runs, from what is stated besides."""
    program = program_of(text)
    means = Means(Deadline(), Effort.of_seconds(GENEROUS.seconds), GENEROUS, seed)
    system = system_of(program, 2)
    known = [
        Claim(each.name, ClaimKind.PROPERTY, each)
        for each in program.properties
        if each.trigger is None and each.name != "Done"
    ]
    stated = liveness_of(system)[-1].stated
    assert stated is not None
    return progress(system, stated, known, means)


def searched(text: str, robots: int) -> Report:
    """What a search says."""
    system: System = dealt(program_of(text), robots, Fraction(1, 10))
    return verification.verify(system, Bounds(6), Engine.SEARCH)


@pytest.mark.parametrize("seed", but_slow((1, 2), (0, 1, 2)))
def test_who_has_a_number_enters(seed: int) -> None:
    found = proof_of(BAKERY + KNOWN, seed)
    assert isinstance(found, ProgressProof), found


@pytest.mark.slow
@pytest.mark.parametrize("robots", but_slow((3,), (2, 3)))
def test_a_search_agrees(robots: int) -> None:
    outcomes = {v.outcome for v in searched(FEW, robots).verdicts}
    assert outcomes == {Outcome.HOLDS}
    assert isinstance(proof_of(FEW + KNOWN), ProgressProof)


@pytest.mark.parametrize("variant", first(1, UNFAIR))
def test_who_is_overtaken_for_ever_is_not_said_to_enter(variant: str) -> None:
    text, old, new = UNFAIR[variant]
    assert old in text
    text = text.replace(old, new)
    report = searched(text, 2)
    (verdict,) = (v for v in report.verdicts if v.claim.name == "Enters")
    assert verdict.outcome is Outcome.VIOLATED
    assert isinstance(proof_of(text), str)


def test_who_is_ready_now_and_then_is_not_said_to_run() -> None:
    (verdict,) = (v for v in searched(FLIPPED, 2).verdicts if v.claim.name == "Done")
    assert verdict.outcome is Outcome.VIOLATED
    assert isinstance(proof_of(FLIPPED), str)


def test_the_first_is_looked_for_where_guards_ask_for_all_numbers() -> None:
    assert [len(list(least_of(program_of(text)))) for text in (BAKERY, FLIPPED)] == [1, 0]


def test_what_help_reads_is_seen() -> None:
    program = program_of(BAKERY)
    reads = [read_by(program, way) for way in help_of(program)]
    # Out, drawing with and without a number, waiting for the others' phases and numbers, critical.
    assert [None if read is None else len(read) for read in reads] == [1, 2, 2, 2, 1]


def test_what_a_sensor_says_is_no_part_of_what_stays() -> None:
    program = program_of(
        "using S:\n  sensors:\n    bool ok\nlocal:\n  bool done = false\n"
        "Do:\n  pre: not done and S.ok\n  eff:\n    done = true\neventually Done: done\n"
    )
    assert [read_by(program, way) for way in help_of(program)] == [None]
