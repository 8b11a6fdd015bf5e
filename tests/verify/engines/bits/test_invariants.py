"""Invariants that were found on bits, in Koord: they hold, and make claims inductive."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from msgspec.structs import replace

from koord.cli.exits import Exit
from koord.cli.main import main
from koord.cli.verdicts import LONGEST_SHOWN, MOST_SHOWN
from koord.syntax.elaboration.settings import Settings
from koord.syntax.load import load
from koord.syntax.printing.quoting import Quoting
from koord.syntax.source import Source
from koord.syntax.system import System
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline, Effort
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, GoalKind
from koord.verify.engines.explicit.search import survey
from koord.verify.engines.induction.proving import prove
from koord.verify.reduction.abstraction import abstracted
from koord.verify.verdicts import Outcome
from tests.sampling import first
from tests.verify.engines.bits.asking import on_bits

EXAMPLES = Path(__file__).parents[4] / "specs" / "examples"


def system_of(text: str, kinds: tuple[int, ...], *found: str, **params: int) -> System:
    """The system of a text, with invariants that were found beside its own."""
    lines = "".join(
        f"invariant Found{k}{' ' if lemma.startswith('at round: ') else ': '}{lemma}\n"
        for k, lemma in enumerate(found)
    )
    sources = (Source("found.krd", lines),) if found else ()
    loaded = load(Source("test.krd", text), Settings(params), sources)
    assert loaded.program is not None, (found, [str(d.message) for d in loaded.diagnostics])
    return System(loaded.program, kinds)


def opaque(system: System) -> System:
    abstraction = abstracted(system.program)
    return system if abstraction is None else replace(system, program=abstraction.program)


def proved(text: str, kinds: tuple[int, ...], **params: int) -> tuple[str, ...]:
    """What is found for the claims of a text: all of them hold, and it is enough for induction."""
    ledger = on_bits(opaque(system_of(text, kinds, **params)), 3)
    verdicts = [ledger.verdict(claim) for claim in ledger.claims]
    assert all(v.outcome is Outcome.HOLDS and v.rounds is None for v in verdicts), verdicts
    assert not any(v.unsaid for v in verdicts), verdicts
    lemmas = dict.fromkeys(lemma for v in verdicts for lemma in v.lemmas)
    found = tuple(map(Quoting.of(ledger.system.program).invariant, lemmas))
    with_them = system_of(text, kinds, *found, **params)
    inductive = prove(
        opaque(with_them),
        claims_of(opaque(with_them)),
        [],
        Deadline.after(60),
        Effort.of_seconds(20),
    )
    assert not inductive.reasons, (found, inductive.reasons)
    return found


def searched(text: str, kinds: tuple[int, ...], found: tuple[str, ...]) -> None:
    """All that was found holds in all configurations that an explicit search reaches."""
    system = system_of(text, kinds, *found)
    stated = [c.stated for c in claims_of(system) if c.stated is not None]
    seen = survey(system, stated, Limits(states=20_000), subjects=frozenset(GoalKind))
    assert isinstance(seen.end, Exhausted)
    assert not seen.violated


def alone(file: str, *names: str) -> str:
    """An example with some of its properties only."""
    kept, skips = [], False
    for line in (EXAMPLES / file).read_text(encoding="utf-8").splitlines():
        stated = re.match(r"(invariant|eventually|\w+ leadsto)\s*(\w*)", line)
        if stated:
            skips = stated[2] not in names
        elif line and not line[0].isspace():
            skips = False
        if not skips:
            kept.append(line)
    return "\n".join(kept) + "\n"


def test_the_assignment_of_tasks_is_said_as_people_would() -> None:
    assert proved(alone("task.krd", "Exclusive"), (0, 0, 0)) == (
        "forall k in 0, 4: forall i: mine@i == k implies list[k].assigned",
        "forall i: -1 <= mine@i and mine@i <= 3",
    )


@pytest.mark.parametrize(
    ("file", "name"),
    first(
        4,
        [
            ("leader_elect.krd", "Agree"),
            ("shortest_path.krd", "Exact"),
            ("sum_of_ids.krd", "Known"),
            ("cars_and_drones.krd", "Once"),
            ("delivery.krd", "Carries"),
            ("delivery.krd", "Once"),
        ],
    ),
)
def test_what_is_found_for_claims_of_examples_makes_them_inductive(file: str, name: str) -> None:
    text = alone(file, name)
    kinds = (0, 0, 1) if "agent " in text else (0, 0, 0)
    assert proved(text, kinds)


HOLDERS = """
allwrite:
    int[2] holder = [-1, -1]
local:
    bool inside = false

Take:
    pre: not inside
    eff:
        atomic:
            for k = 0, 2:
                if holder[k] == -1: holder[k] = pid
Enter:
    pre: holder[0] == pid and holder[1] == pid
    eff: inside = true
Leave:
    pre: inside
    eff:
        inside = false
        atomic:
            for k = 0, 2:
                holder[k] = -1

invariant Alone: forall i, j: i != j implies not (inside@i and inside@j)
"""


def test_robots_that_variables_hold_are_spoken_of_like_others() -> None:
    found = proved(HOLDERS, (0, 0, 0))
    assert any("forall i: inside@i implies holder[" in lemma for lemma in found), found
    assert any("== i" in lemma for lemma in found), found
    assert not any(re.search(r"@\d", lemma) for lemma in found), found


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Carries", "Once"])
def test_robots_that_variables_hold_are_spoken_of_without_their_numbers(name: str) -> None:
    found = proved(alone("delivery.krd", name), (0, 0, 0))
    assert not any(re.search(r"@\d", lemma) for lemma in found), found


SHELVES = """
allwrite:
    bool[3] used = [false, false, false]
    bool[3] dirty = [true, true, true]
local:
    int mine = -1
    bool bad = false

Take:
    pre: mine == -1
    eff:
        atomic:
            for k = 0, 3:
                if not used[k] and mine == -1:
                    used[k] = true
                    dirty[k] = false
                    mine = k
Check:
    pre: mine != -1
    eff:
        if dirty[mine]: bad = true
Give:
    pre: mine != -1
    eff:
        atomic:
            used[mine] = false
            dirty[mine] = true
            mine = -1

invariant Clean: forall i: not bad@i
"""


def test_clauses_that_differ_in_a_number_are_one_and_others_are_not() -> None:
    found = proved(SHELVES, (0, 0, 0, 0))
    assert "forall k in 0, 3: forall i: mine@i == k implies used[k]" in found
    # What is not said of all shelves alike is said of those that are alike, and of the other.
    of_two, of_one = sorted((x for x in found if "dirty" in x), key=lambda x: "forall k" not in x)
    alike, other = ("1, 3", 0) if of_two.startswith("forall k in 1, 3: ") else ("0, 2", 2)
    assert of_two.startswith(f"forall k in {alike}: ")
    assert f"dirty[{other}]" in of_one
    assert "forall i, j: i != j and mine@i == mine@j implies mine@i == -1" in found


KINDS = """
enum Colour: red, green, blue, black

agent Car:
    local:
        Colour c = red
        bool flag = false
    Go:
        pre: c == red
        eff: c = green
    Back:
        pre: c == green or c == black
        eff:
            c = red
            if flag: c = blue
            flag = c == black

agent Drone:
    local:
        int b = 0
        string s = "up"
    Up:
        pre: b < 3 and s == "up"
        eff:
            b = b + 1
            s = "down"
    Down:
        pre: s == "down"
        eff:
            s = "up"
            if b == 7: s = "lost"

invariant NeverBlue: forall Car i: c@i != blue
invariant Known: forall Drone d: s@d != "lost"
"""

TOKEN = """
enum Where: outside, waiting, inside

allwrite:
    int holder = 0
local:
    Where at = outside

Ask:
    pre: at == outside
    eff: at = waiting
Enter:
    pre: at == waiting and holder == pid
    eff: at = inside
Leave:
    pre: at == inside
    eff:
        at = outside
        atomic: holder = (pid + 1) % numAgents

invariant Alone: forall i, j: i != j implies not (at@i == inside and at@j == inside)
"""

UNSET = """
local:
    int goal
    bool has = false
    int tries = 0

Choose:
    pre: not has
    eff:
        goal = tries + 1
        has = true
Give:
    pre: has and goal < 3
    eff:
        has = false
        tries = (tries + 1) % 2

invariant Small: forall i: has@i implies goal@i <= 2
"""

URGENT = """
allread:
    int[] x = 0
local:
    int y = 0

urgent Up:
    pre: y < 2
    eff:
        y = y + 1
        x[pid] = y
Down:
    pre: y == 2
    eff:
        y = 0
        x[pid] = 0

invariant Same at round: forall i: x[i] != y@i + 1
"""

PORTS = """
using Tank:
    sensors:
        int level = 0
    actuators:
        bool open = false
    environment:
        if open and level < 4: level = level + 2
        elif not open and level > 0: level = level - 2
local:
    bool full = false

Fill:
    pre: Tank.level == 0
    eff:
        Tank.open = true
        full = false
Rest:
    pre: Tank.level == 4
    eff:
        Tank.open = false
        full = true

invariant Even: forall i: Tank.level@i != 3 and Tank.level@i != 1
invariant Full: forall i: full@i implies not Tank.open@i
"""

STOPS = """
local:
    int left = 2
    bool done = false
Work:
    pre: left > 0
    eff:
        left = left - 1
        if left == 0:
            done = true
            stop
Odd:
    pre: done
    eff: left = 7

invariant Once: forall i: left@i <= 2
"""


OPAQUE = """
def fun chosen(int k) -> pos: extern fresh
def fun free(pos x) -> bool: extern
def fun clear(pos x, pos y) -> bool: extern

allread:
    pos[] at = pos(0.0, 0.0, 0.0)
local:
    pos a = pos(0.0, 0.0, 0.0)
    pos b = pos(0.0, 0.0, 0.0)
    bool has = false
    bool bad = false

Pick:
    pre: not has
    eff:
        a = chosen(pid)
        b = chosen(pid)
        if clear(a, b) and free(a):
            has = true
            at[pid] = a
Use:
    pre: has
    eff:
        has = false
        if not clear(a, b) or not free(at[pid]) or at[pid] != a: bad = true

invariant Good: forall i: not bad@i
"""


def test_what_nobody_looks_into_is_spoken_of_by_functions() -> None:
    assert set(proved(OPAQUE, (0, 0))) == {
        "forall i: has@i implies clear(a@i, b@i)",
        "forall i: has@i implies at[i] == a@i",
        "forall i: has@i implies free(at[i])",
    }


#: Who asked to stop no property can say, and the claim needs it.
ASKS = """
local:
    bool ready = false
Ask:
    pre: not ready
    eff:
        ready = true
        trystop()

invariant Ready: forall i: stopped@i implies ready@i
"""


def test_what_cannot_be_said_has_a_reason() -> None:
    ledger = on_bits(system_of(ASKS, (0, 0)), 3)
    (verdict,) = [ledger.verdict(claim) for claim in ledger.claims if claim.name == "Ready"]
    assert verdict.outcome is Outcome.HOLDS
    assert verdict.lemmas == ()
    assert verdict.unsaid == "it is about who asked to stop"


@pytest.mark.parametrize(
    ("text", "kinds"),
    [
        (KINDS, (0, 0, 1)),
        (TOKEN, (0, 0, 0)),
        (UNSET, (0, 0)),
        (URGENT, (0, 0)),
        (PORTS, (0, 0)),
        (STOPS, (0, 0)),
    ],
    ids=["kinds", "token", "unset", "urgent", "ports", "stops"],
)
def test_what_is_found_holds_and_makes_claims_inductive(text: str, kinds: tuple[int, ...]) -> None:
    found = proved(text, kinds)
    searched(text, kinds, found)


@pytest.mark.slow
def test_what_was_found_is_kept_and_taken_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, found = tmp_path / "elect.krd", tmp_path / "found.krd"
    program.write_text(alone("leader_elect.krd", "Agree"), encoding="utf-8")
    ask = ["verify", str(program), "--robots", "3", "--engine"]
    assert main([*ask, "induction"]) == Exit.UNKNOWN
    capsys.readouterr()
    assert main([*ask, "bits", "--save-invariants", str(found)]) == Exit.OK
    kept = re.findall(r"^invariant Found\d+: (.*)$", found.read_text("utf-8"), re.MULTILINE)
    assert len(kept) > MOST_SHOWN
    said = capsys.readouterr().out
    readable = [text for text in kept if len(text) <= LONGEST_SHOWN][:MOST_SHOWN]
    assert [text for text in kept if f"    {text}\n" in said] == readable
    assert f"… {len(kept) - len(readable)} more" in said
    assert "elect.krd: 3 robots" in found.read_text("utf-8")
    # What some of them suppose never comes true: that is told, and they hold all the same.
    assert main([*ask, "induction", "--with", str(found)]) in (Exit.OK, Exit.VACUOUS)
