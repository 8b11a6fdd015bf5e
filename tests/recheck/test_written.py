"""A certificate that koord wrote is never refuted: it is confirmed, or not settled in time.

Also where assumptions, contracts or summaries contradict each other: then all is shown of nothing.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from random import Random

import pytest

from koord.recheck.checking import Rechecked, RecheckOutcome
from koord.syntax.elaboration.settings import Settings
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System, dealt
from koord.verify.certificates import Texts, certificate, shown_by
from koord.verify.effort import Deadline
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds
from tests.recheck.certificates import EXAMPLES, rechecked

pytest.importorskip("cvc5")

ASSUMED = (
    "assume: n == 0\n",
    "assume: n <= m\nassume: n >= 0\nassume: m <= 2\n",
    "assume: n < m\nassume: m < n\n",  # nothing begins
    "assume: n > 0\nassume: forall i: n@i < 1\n",  # nor so
    "assume: k > 5\n",  # nor so
    "assume: forall i, j: i != j implies n@i != n@j\nassume: 0 <= n and n <= 1\n",  # of 3 or more
)

PROMISED = (
    "",
    "        ensures: heat' >= heat\n",
    "        ensures: heat' > heat and heat' < heat\n",  # no round ends
    "        ensures: heat' == heat + n\n" * 0
    + "        requires: heat > 0\n        ensures: false\n",
    "        ensures: heat' == heat + 1\n",
)

SUMMED = (
    "result >= x",
    "result > x and result < x",
    "result == x",
    "false",
    "result == x + 1 or result == x",
)

GUARDS = ("n < k", "n < 2 and not go", "go", "n >= 0", "heat > 0", "c < 2", "false")
EFFECTS = (
    "n = n + 1",
    "m = n",
    "go = not go",
    "n = near(n)",
    "atomic: c = c + 1",
    "n = 0",
    "m = 2 - n",
)
CLAIMS = (
    "n <= 2",
    "n <= k",
    "m <= 2",
    "c <= 2",
    "n >= 0",
    "go implies n > 0",
    "heat >= 0",
    "n == m",
    "n <= 1",
)


def text_of(random: Random) -> str:
    """A small program, of which as much as may be is left to chance."""
    fixed = random.random() < 0.4
    start = " = 0" if fixed else ""
    assumed = "" if fixed and random.random() < 0.5 else random.choice(ASSUMED)
    contract = random.choice(PROMISED)
    promised = f"    contract Promised:\n{contract}" if contract else ""
    events = [
        f"Event{k}:\n    pre: {random.choice(GUARDS)}\n    eff:\n"
        + "".join(f"        {e}\n" for e in random.sample(EFFECTS, random.choice((1, 1, 2))))
        for k in range(random.choice((1, 2)))
    ]
    claims = [
        f"invariant Claim{k}{random.choice(('', ' at round'))}: {claim}\n"
        for k, claim in enumerate(random.sample(CLAIMS, 3))
    ]
    return (
        "param int k = 1\n"
        f"using Room:\n    sensors:\n        int heat\n{promised}"
        "allwrite:\n    int c = 0\n"
        f"local:\n    int n{start}\n    int m{start}\n    bool go = false\n"
        f"def fun near(int x) -> int: extern\n    ensures: {random.choice(SUMMED)}\n"
        f"{assumed}{''.join(events)}{''.join(claims)}"
    )


def written(text: str, robots: int) -> Rechecked | None:
    """What becomes of the certificate of a program; None if nothing can be certified."""
    source, settings = Source("made.krd", text), Settings({})
    elaborated = load(source, settings)
    assert elaborated.program is not None, elaborated.diagnostics
    return _of(source, settings, dealt(elaborated.program, robots), 5.0)


def _of(source: Source, settings: Settings, system: System, seconds: float) -> Rechecked | None:
    shown = shown_by(verify(system, Bounds(3, seconds), None))
    if not shown.holding:
        return None
    texts = Texts(source, (), settings)
    made = certificate(system, texts, shown, Deadline.after(seconds), "test")
    return None if made is None else rechecked(json.loads(json.dumps(made.document)))


def outcomes(first: int, last: int) -> Counter[str]:
    count: Counter[str] = Counter()
    for seed in range(first, last):
        random = Random(seed)
        found = written(text_of(random), random.choice((1, 2, 3)))
        if found is None:
            count["nothing"] += 1
            continue
        assert found.outcome is not RecheckOutcome.REFUTED, (seed, found.reason)
        count[found.outcome.value] += 1
        count["hollow"] += bool(found.hollow)
    return count


#: The bound hangs on what is known of `cos`, which solvers have functions of their own for.
TURNED = """\
local:
    float angle = 0.0
    float ahead = 1.0
Turn:
    eff:
        angle = angle + 0.5
        ahead = 2 * cos(angle)
invariant Near: ahead <= 2
"""


def test_functions_that_other_solvers_know_are_the_program_s_there() -> None:
    found = written(TURNED, 2)
    assert found is not None
    assert found.outcome is RecheckOutcome.CONFIRMED


@pytest.mark.slow
def test_certificates_of_some_programs_are_not_refuted() -> None:
    count = outcomes(0, 4)
    assert count["confirmed"] >= 2
    assert count["hollow"] >= 1


@pytest.mark.slow
@pytest.mark.parametrize("block", range(4))
def test_certificates_of_many_programs_are_not_refuted(block: int) -> None:
    count = outcomes(8 + 50 * block, 58 + 50 * block)
    assert count["confirmed"] >= 20
    assert count["hollow"] >= 5


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.krd")), ids=lambda path: path.stem)
def test_certificates_of_examples_are_not_refuted(path: Path) -> None:
    source, settings = Source(path.name, path.read_text("utf-8")), Settings({})
    program = load(source, settings).program
    assert program is not None
    kinds = program.instance.kinds
    system = System(program, kinds, program.instance.used_delta_s) if kinds else dealt(program, 2)
    found = _of(source, settings, system, 30.0)
    assert found is None or found.outcome is not RecheckOutcome.REFUTED
