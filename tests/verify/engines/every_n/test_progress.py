"""Progress of every number of robots: what is proved, and what must not be. [T-PROGRESS]

[FAIR-ROBOT] [FAIR-LOCK] [FAIR-ASSUME] Each claim that is not to be proved is violated with few
robots, as the search for lassos says; one premise speaks against each.
"""

from __future__ import annotations

import pytest

from koord.syntax import core
from koord.syntax.system import System
from koord.verify.claims import liveness_of
from koord.verify.effort import Deadline, Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.every_n.progress import _Search
from koord.verify.engines.every_n.progress_parts import Help, HelpKind, Phrase, measures_of
from koord.verify.engines.every_n.progress_questions import RoundQuestions
from koord.verify.engines.every_n.questions import GENEROUS, Means
from koord.verify.strategy import verification
from koord.verify.verdicts import Bounds, Outcome, Verdict
from tests.loading import program_of, protocol_text
from tests.sampling import first
from tests.verify.asking import system_of

ONCE = """
local:
  bool done = false
Do:
  pre: not done
  eff:
    done = true
eventually Done: done
"""

IDLE = ONCE + "Idle:\n  pre: not done\n  eff:\n    done = done\n"

LOCK = """
allwrite:
  bool free = true
local:
  bool holds = false
Take:
  pre: free and not holds
  eff:
    atomic:
      free = false
      holds = true
Give:
  pre: holds
  eff:
    atomic:
      free = true
      holds = false
invariant Held: free or exists i: holds@i
eventually Enters: not holds leadsto holds
"""

EXPECTED = """
using S:
  sensors:
    bool ok
local:
  bool asked = false
  bool done = false
Ask:
  pre: not asked
  eff:
    asked = true
Do:
  pre: asked and not done and S.ok
  eff:
    done = true
assume Does: asked leadsto ran(Do)
eventually Done: done
"""

COUNTED = """
allwrite:
  int left = 5
Down:
  pre: left > 0
  eff:
    atomic:
      left = left - 1
eventually Empty: left <= 0
"""

PHASES = """
enum Phase: out, waiting, inside
local:
  Phase phase = out
Come:
  pre: phase == out
  eff:
    phase = waiting
Go:
  pre: phase == waiting
  eff:
    phase = inside
eventually Enters: phase == waiting leadsto phase == inside
"""

TIMED = """
using S:
  sensors:
    float now = 0.0
  environment:
    now = min(now + 1.0, 10.0)
local:
  bool done = false
Do:
  pre: not done and S.now >= 3.0
  eff:
    done = true
eventually Done: done
"""

#: Programs whose claim holds for every number of robots, with the fairness that proofs rest on.
HOLDING = {
    "each does it once": (ONCE, ("robots",)),
    "who asks for a lock enters": (LOCK, ("robots", "locks")),
    "what is expected comes about": (EXPECTED, ("robots", "Does")),
    "a number falls to its end": (COUNTED, ("robots",)),
    "who waits goes on": (PHASES, ("robots",)),
    "what one waits for comes about": (TIMED, ("robots",)),
}

#: Programs whose claim is violated with so many robots, by the premise that speaks against it.
VIOLATED = {
    "a robot may run something else": (IDLE, 1),
    "a robot may run something else, and not ask": (
        LOCK + "Idle:\n  pre: not holds\n  eff:\n    holds = holds\n",
        2,
    ),
    "who is granted the lock does not enter": (
        LOCK + "Peek:\n  pre: free and not holds\n  eff:\n    atomic:\n      free = free\n",
        1,
    ),
    "who asks for a lock is granted it, in vain": (
        """
allwrite:
  bool open = true
local:
  bool done = false
Peek:
  pre: open
  eff:
    atomic:
      open = open
Do:
  pre: not open and not done
  eff:
    done = true
eventually Done: done
""",
        1,
    ),
    "one robot is not there": (ONCE.replace("pre: not done", "pre: not done and numAgents > 1"), 1),
    "time comes to an end": (TIMED.replace("10.0", "2.0"), 1),
    "time goes to and fro": (TIMED.replace("min(now + 1.0, 10.0)", "1.0 - now"), 1),
    "robots stop before": (ONCE + "Quit:\n  pre: not done\n  eff:\n    stop\n", 1),
    "the environment need not say so": (
        "def fun coin() -> bool: extern fresh\n" + ONCE.replace("pre: not", "pre: coin() and not"),
        1,
    ),
    "what is expected goes again": (
        EXPECTED.replace("assume Does: asked leadsto ran(Do)", "assume Does: asked leadsto S.ok"),
        1,
    ),
    "what is expected of another event": (
        IDLE + "assume Does: ran(Do) leadsto done\n",
        1,
    ),
    "what is expected comes about without the robot": (
        EXPECTED.replace(
            "assume Does: asked leadsto ran(Do)", "assume Does: ran(Ask) leadsto ran(Ask)"
        ),
        1,
    ),
    "what leads to the goal is left without it": (
        PHASES + "Away:\n  pre: phase == waiting\n  eff:\n    phase = out\n",
        1,
    ),
    "what leads to the goal is left for ever": (
        PHASES.replace("waiting, inside", "waiting, inside, gone")
        + "Away:\n  pre: phase == waiting\n  eff:\n    phase = gone\n",
        1,
    ),
    "who helps is interrupted": (
        """
allwrite:
  bool turn = false
local:
  bool done = false
Toggle:
  pre: 0 < pid and pid < numAgents - 1
  eff:
    atomic:
      turn = not turn
First:
  pre: pid == 0 and turn and not done
  eff:
    done = true
Last:
  pre: pid == numAgents - 1 and not turn and not done
  eff:
    done = true
eventually Some: exists i: done@i
""",
        3,
    ),
    "who stopped may have found what is so no longer": (
        """
allwrite:
  bool early = true
local:
  bool done = false
Quit:
  pre: early and not done and pid > 0
  eff:
    if early and pid > 0:
      stop
Close:
  pre: early and pid == 0
  eff:
    atomic:
      early = false
Do:
  pre: not early and not done
  eff:
    done = true
eventually Done: done
""",
        2,
    ),
    "robots take from each other what one needs": (
        """
allwrite:
  int turn = 0
local:
  bool done = false
Grab:
  pre: turn != pid
  eff:
    atomic:
      turn = pid
Do:
  pre: turn == pid and not done
  eff:
    done = true
invariant Real: 0 <= turn and turn < numAgents
eventually Some: exists i: done@i
""",
        2,
    ),
    "what one gives away another takes": (
        """
allwrite:
  bool spare = true
allread:
  bool[] up = false
Down:
  pre: up[pid]
  eff:
    up[pid] = false
    atomic:
      spare = true
Up:
  pre: not up[pid] and spare
  eff:
    up[pid] = true
    atomic:
      spare = false
eventually Never: forall i: up[i] and spare
""",
        1,
    ),
    "a flag goes up and down": (
        """
allwrite:
  bool open = false
local:
  bool through = false
Open:
  pre: not open and pid == 0
  eff:
    atomic:
      open = true
Close:
  pre: open and pid == 0
  eff:
    atomic:
      open = false
Pass:
  pre: open and not through and pid > 0
  eff:
    through = true
eventually Through: through or pid == 0
""",
        2,
    ),
}


def asked(text: str, robots: int, engine: Engine) -> Verdict:
    """The verdict on the claim about whole runs of a program."""
    report = verification.verify(of(text, robots), Bounds(6), engine)
    (verdict,) = (v for v in report.verdicts if v.claim.kind.value == "liveness")
    return verdict


def of(text: str, robots: int) -> System:
    return system_of(program_of(text), robots)


@pytest.mark.parametrize("name", HOLDING)
def test_claims_are_proved_for_every_number_of_robots(name: str) -> None:
    text, fairness = HOLDING[name]
    verdict = asked(text, 2, Engine.EVERY_N)
    assert verdict.outcome is Outcome.HOLDS, verdict.reason
    assert verdict.engine is Engine.EVERY_N
    assert verdict.fairness == fairness


@pytest.mark.parametrize("name", [name for name in HOLDING if "expected" not in name])
@pytest.mark.parametrize("robots", [1, 2, 3])
def test_what_is_proved_the_search_finds_as_well(name: str, robots: int) -> None:
    text, _ = HOLDING[name]
    assert asked(text, robots, Engine.SEARCH).outcome is Outcome.HOLDS


@pytest.mark.parametrize("name", first(1, VIOLATED))
def test_what_fails_with_some_number_is_not_proved(name: str) -> None:
    text, robots = VIOLATED[name]
    assert asked(text, 2, Engine.EVERY_N).outcome is Outcome.UNKNOWN
    assert asked(text, robots, Engine.SEARCH).outcome is Outcome.VIOLATED


def test_a_number_without_an_end_settles_nothing() -> None:
    """[T-PROGRESS] A measure that falls for ever is no natural number."""
    text = COUNTED.replace("pre: left > 0", "pre: left != 9").replace("left <= 0", "left == 9")
    assert asked(text, 2, Engine.EVERY_N).outcome is Outcome.UNKNOWN


def test_time_that_passes_ever_more_slowly_comes_to_no_end() -> None:
    """[T-PROGRESS] What falls by less and less need not fall below anything."""
    text = TIMED.replace("now = min(now + 1.0, 10.0)", "now = now + (3.0 - now) / 2.0")
    assert text != TIMED
    assert asked(text, 1, Engine.EVERY_N).outcome is Outcome.UNKNOWN


def test_what_holds_of_this_number_of_robots_is_no_reason() -> None:
    text = ONCE.replace("pre: not done", "pre: not done and numAgents <= 2")
    report = verification.verify(of(text + "invariant Few: numAgents <= 2\n", 2), Bounds(6))
    few, done = (v for v in report.verdicts if v.claim.name in ("Few", "Done"))
    assert few.outcome is done.outcome is Outcome.HOLDS
    assert done.engine is not Engine.EVERY_N


# --- ways to help that nobody would guess ---------------------------------------------------------


STATE = "eventually State: not done\n"


def refused(text: str, kind: HelpKind, expectation: int | None = None) -> bool:
    """Whether help of a robot in the state that the second claim is about can be refused."""
    system = of(text, 2)
    claim, state = system.program.properties
    assert state.each is not None
    phrase = Phrase(state.condition, state.bound, state.each.variable.slot, None)
    help_ = Help(kind, phrase, core.RobotRange(None), expectation)
    means = Means(Deadline(), Effort.of_seconds(GENEROUS.seconds), GENEROUS, 0)
    questions = RoundQuestions(system, claim, [], means)
    questions.pend(())
    for measure in measures_of(system.program, claim):
        questions.keep(measure)
    return not questions.helping([help_])


def test_who_is_ready_is_not_refused_for_ever() -> None:
    assert not refused(ONCE + STATE, HelpKind.ROBOT)


def test_who_is_not_ready_is() -> None:
    text = ONCE.replace("pre: not done", "pre: not done and pid > 0") + STATE
    assert refused(text, HelpKind.ROBOT)


def test_who_stopped_is() -> None:
    text = ONCE + "Quit:\n  pre: not done\n  eff:\n    stop\n" + STATE
    assert refused(text, HelpKind.ROBOT)


def test_what_is_expected_has_a_reason() -> None:
    assert refused(EXPECTED + STATE, HelpKind.EXPECTED, 0)
    # What it is expected of is where it is asked, too.
    reason = EXPECTED.replace("assume Does: asked leadsto", "assume Does: not done leadsto")
    assert not refused(reason + STATE, HelpKind.EXPECTED, 0)


# --- what is known to be enough -------------------------------------------------------------------


def test_help_is_not_enough_where_a_lock_may_not_be_granted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked_with: list[list[int]] = []

    def noted(search: _Search, ways: object, locks: list[int]) -> bool:
        asked_with.append(list(locks))
        return locks != []

    monkeypatch.setattr(_Search, "_somebody_helps", noted)
    system = of(protocol_text("lock_server"), 3)
    (stated,) = [claim.stated for claim in liveness_of(system)]
    assert stated is not None
    means = Means(Deadline(), Effort.of_seconds(GENEROUS.seconds), GENEROUS, 0)
    search = _Search(system, stated, [], means)
    search.help = list(search.likely)
    every_lock = search._classes()
    assert every_lock
    assert search._somebody_may_help()
    assert not search._is_enough()
    search.locks = list(every_lock)
    assert search._is_enough()
    assert asked_with == [every_lock, []]  # what is known already is not asked again
