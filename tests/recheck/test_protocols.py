"""Proofs that are found for every number of robots, with their lemmas, are confirmed by cvc5."""

from __future__ import annotations

import json
from fractions import Fraction

import pytest

from koord.recheck.checking import RecheckOutcome
from koord.syntax.elaboration.settings import Settings
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import dealt
from koord.verify.certificates import Texts, certificate, shown_by
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds
from tests.loading import PROTOCOLS, protocol_text
from tests.recheck.certificates import Document, rechecked
from tests.sampling import but_slow, first

pytest.importorskip("cvc5")

#: What has no proof for every number of robots, or none that is whole.
OPEN = {"charging_queue", "coherence_msi", "dekker", "peterson", "raft_votes"}

#: What cvc5 has no answer to in the time that a question has.
TOO_MUCH = {"dijkstra_ring", "firewall"}

FAST = {"leader_lease", "lock_server"}
ALL = sorted({path.stem for path in PROTOCOLS.glob("*.krd")} - OPEN)


def found(name: str) -> Document:
    """The certificate of what is proved of a protocol, and of nothing else."""
    source = Source(f"{name}.krd", protocol_text(name))
    settings = Settings({})
    program = load(source, settings).program
    assert program is not None
    system = dealt(program, 2, Fraction(1, 10))
    shown = shown_by(verify(system, Bounds(3), Engine.EVERY_N))
    assert shown.everyone
    made = certificate(system, Texts(source, (), settings), shown, Deadline.after(120), "test")
    assert made is not None
    claims = made.document["claims"]
    assert isinstance(claims, list)
    assert {claim["name"] for claim in claims if claim["every_number"]} >= shown.everyone
    return dict(json.loads(json.dumps(made.document)))


@pytest.mark.parametrize("name", first(1, but_slow(set(ALL) - FAST, ALL)))
def test_what_is_found_is_confirmed_for_every_number(name: str) -> None:
    said = rechecked(found(name))
    assert said.everyone is not None
    unsettled = {RecheckOutcome.UNKNOWN} if name in TOO_MUCH else set()
    assert said.everyone.outcome in {RecheckOutcome.CONFIRMED, *unsettled}, said.reason
