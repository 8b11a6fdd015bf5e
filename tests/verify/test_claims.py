"""What is claimed of a system, and which configurations each claim is about."""

from __future__ import annotations

import pytest

from koord.recheck.steps import updated as updated_again
from koord.syntax import core
from koord.syntax.analysis.footprint import rewritten
from koord.syntax.system import System, dealt
from koord.syntax.types import BOOL, INT
from koord.verify.claims import NO_FAULT, Claim, ClaimKind, ClaimPhase, claims_of, liveness_of
from tests.loading import program_of
from tests.semantics import programs
from tests.semantics.building import TRUE, Build, I, bound, contract, forall
from tests.verify.reference import updates


def names(program: core.Program, robots: int = 2) -> list[str]:
    return [claim.name for claim in claims_of(dealt(program, robots))]


def test_everything_that_the_program_says_and_what_is_asked_of_every_program() -> None:
    """[PROP-INVARIANT] [PROP-CONTRACT] [FAULT] [LOST-UPDATE]"""
    assert names(programs.sum_of_ids()) == ["Bounded", "Sure", "no fault"]
    assert names(programs.counter_race()) == ["Counted", "no fault", "no lost update of count"]
    assert names(programs.thermostat()) == ["Comfort", "no fault", "contract KeepsWarm"]
    # Contracts of modules without a model are assumed.
    assert names(programs.rover()) == ["no fault"]


def test_a_robot_that_is_alone_loses_no_updates() -> None:
    """[LOST-UPDATE]"""
    assert names(programs.counter_race(), robots=1) == ["Counted", "no fault"]


def test_updates_in_atomic_blocks_are_not_asked_about() -> None:
    """[LOST-UPDATE] [ATOMIC]: nor is a write that reads another variable."""
    b = Build()
    x, y = b.allwrite("x", INT, 0), b.allwrite("y", INT, 0)
    b.event("Go", TRUE, b.atomic(x.set(x + 1)), y.set(x))
    assert names(b.program()) == ["no fault"]


@pytest.mark.parametrize(
    ("effect", "updated"),
    [
        ("w = w + 1", "w"),
        ("n = w\nw = n + 1", "w"),
        ("n = w\nm = n\natomic: m = n\nw = m", "w"),
        ("for x in ws:\n  n = n + x\nws[0] = n", "ws"),
        ("for k, x in ws:\n  ws[0] = k", "ws"),
        ("append(xs, w)\nn = pop(xs)\nw = n", "w"),
        ("atomic: n = w\nif n == 0: w = n", "w"),
        ("n = w\nws[n] = 3", ""),
        ("if w == 0: w = pid", ""),
        ("n = w\nw = pid", ""),
        ("n = w\natomic: w = n + 1", ""),
        ("n = w\nfor k = 0, 2: w = k", ""),
        ("v = w", ""),
        ("ps[1].x = 2.0", "ps"),
        ("es[1][0].y = 1.0", "es"),
        ("es[1][0] = ps[2]", "es"),
        ("ns[pid][1] = 2", "ns"),
        ("append(xs, 1)\nns[0][0] = pop(xs)", "ns"),
        ("append(xs, 1)\nms[0] = pop(xs)", ""),
        ("ps[1] = pos(1.0, 2.0, 3.0)", ""),
        ("es[1] = [ps[2], ps[3]]", ""),
        ("atomic: ps[1].x = 2.0", ""),
        ("qs[1].x = 2.0", ""),
    ],
)
def test_what_an_update_is(effect: str, updated: str) -> None:
    """[LOST-UPDATE]: the same to the verifier, to who checks proofs again, and to the tests."""
    lines = "".join(f"    {line}\n" for line in effect.splitlines())
    text = (
        "allwrite:\n  int w = 0\n  int v = 0\n  int[3] ws = [0, 0, 0]\n  Map<int, pos> ps = {}\n"
        "  Map<int, pos[]> es = {}\n  Map<int, Map<int, int>> ns = {}\n  Map<int, int> ms = {}\n"
        "local:\n  int n = 0\n  int m = 0\n  int[] xs = []\n  Map<int, pos> qs = {}\n"
        f"Go:\n  eff:\n{lines}"
    )
    program = program_of(text)
    slots = {d.variable.name: d.variable.slot for d in program.allwrite}
    expected = frozenset(slots[name] for name in updated.split())
    assert rewritten(program).get((0, 0), frozenset()) == expected
    assert updates(program)[0, 0] == expected
    assert {slots[name] for name in updated_again(program.agents[0].events[0].effect)} == expected


def test_one_claim_for_contracts_of_one_name() -> None:
    """Two kinds of robot with the same module, say."""
    b = Build()
    for kind in ("One", "Two"):
        b.agent(kind)
        heat = b.sensor("heat", INT, 0)
        b.module("Unit", [heat.set(0)], contracts=[contract("Cold", [], [heat.primed.eq(0)])])
    claims = claims_of(System(b.program(), (0, 1)))
    assert [claim.name for claim in claims] == ["no fault", "contract Cold"]


def test_liveness_is_kept_apart() -> None:
    b = Build()
    truth = core.Const(True, BOOL)
    live = core.Property("Some", core.PropertyKind.EVENTUALLY, truth, 0)
    b.properties.append(live)
    assert names(b.program()) == ["no fault"]
    assert [c.stated for c in liveness_of(dealt(b.program(), 2))] == [live]


def phases(claim: Claim) -> set[ClaimPhase]:
    return {phase for phase in ClaimPhase if claim.looked_at(phase)}


def test_each_claim_is_about_some_configurations() -> None:
    """[PROP-INVARIANT] [PROP-ROUND] [T-PREFIX]"""
    b = Build()
    x, heat = b.local("x", INT, 0), b.sensor("heat", INT, 0)
    b.module("Unit", [heat.set(0)], contracts=[contract("Cold", [], [heat.primed.eq(0)])])
    shared = b.allwrite("s", INT, 0)
    b.event("Go", TRUE, shared.set(shared + 1), x.set(1))
    b.invariant("Local", forall(I, x.at(I).eq(0)))
    b.invariant("Port", forall(I, heat.at(I).eq(0)))
    b.invariant("AtRound", forall(I, x.at(I).eq(0)), at_round=True)
    about = {claim.name: phases(claim) for claim in claims_of(dealt(b.program(), 2))}
    assert about == {
        # The environment's turn changes ports only.
        "Local": {ClaimPhase.INIT, ClaimPhase.INSIDE, ClaimPhase.MIDDLE},
        "Port": set(ClaimPhase),
        "AtRound": {ClaimPhase.INIT, ClaimPhase.END},
        "no fault": set(ClaimPhase),
        "no lost update of s": {ClaimPhase.INSIDE, ClaimPhase.MIDDLE},
        "contract Cold": {ClaimPhase.END},
    }


def test_a_port_may_be_read_in_a_function() -> None:
    b = Build()
    heat, n = b.sensor("heat", INT, 0), bound("n", 0, INT)
    b.module("Unit", [heat.set(1)])
    b.function("warm", [n], BOOL, core.Return((heat > n).expr))
    b.invariant("Cold", ~b.call("warm", 0))
    (claim, _) = claims_of(dealt(b.program(), 1))
    assert ClaimPhase.END in phases(claim)


def test_only_properties_speak_of_configurations() -> None:
    """The others are about steps, and may not be assumed of a configuration."""
    assert not NO_FAULT.is_state_property
    kinds = {kind: Claim("", kind).is_state_property for kind in ClaimKind}
    assert [kind for kind, is_one in kinds.items() if is_one] == [ClaimKind.PROPERTY]
