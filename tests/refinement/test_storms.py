"""Robots in network namespaces, with frames lost, doubled, late and overtaken. (R-COMMIT)"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import pytest

from koord.refinement.deployed import Expedition
from koord.refinement.running import ready
from koord.runtime.chaos.network import Faults
from koord.syntax.system import dealt
from tests.refinement import ethernet
from tests.refinement.running import program, sources
from tests.refinement.storms import storm

EXAMPLES = Path(__file__).resolve().parents[2] / "specs/examples"
STORM = Faults(loss=0.3, duplication=0.05, least_delay_s=0.0, most_delay_s=0.05)


@cache
def reason() -> str | None:
    return ethernet.why_not()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sum_of_ids", "leader_elect", "task"])
@pytest.mark.parametrize("kill_every_s", [None, 4.0], ids=["storm", "and killed coordinators"])
def test_eight_robots_in_a_storm_do_what_the_rules_allow(
    name: str, kill_every_s: float | None
) -> None:
    why = reason()
    if why is not None:
        pytest.skip(why)
    text = (EXAMPLES / f"{name}.krd").read_text("utf-8")
    made = ready(program(text))
    system = dealt(made.program, 8)
    expedition = Expedition(made, system, sources(text), None, seed=7)
    stormy = storm(expedition, STORM, 12.0, kill_every_s)
    assert stormy.judged.refused is None
    assert stormy.rounds > 20
    assert stormy.judged.steps > 8 * (stormy.rounds - 2)
    if kill_every_s is not None:
        assert stormy.kills >= 1
        assert len(stormy.successions) == stormy.kills


# --- the hub by itself ----------------------------------------------------------------------------


def test_the_hub_loses_doubles_and_delays(tmp_path: Path) -> None:
    faults = Faults(loss=0.3, duplication=0.2, least_delay_s=0.0, most_delay_s=0.01)
    hub = ethernet.BadHub(tmp_path / "hub", faults, seed=1)
    hub.cards = {pid: os.open(os.devnull, os.O_RDWR) for pid in range(3)}
    group = bytes.fromhex("01005e4b0101") + bytes((2, 0, 0, 0, 75, 1)) + b"\x08\x00"
    for _ in range(500):
        hub._take(group)
    arriving = [pid for _, _, pid, _ in hub._under_way]
    assert 0 not in arriving  # whose it is
    assert 750 < len(arriving) < 930  # 1000 × 1.2 × 0.7
    numbers = [number for _, number, _, _ in sorted(hub._under_way)]
    assert numbers != sorted(numbers)
    hub._under_way.clear()
    one = bytes((2, 0, 0, 0, 75, 3)) + bytes((2, 0, 0, 0, 75, 1)) + b"\x08\x00"
    for _ in range(50):
        hub._take(one)
    assert {pid for _, _, pid, _ in hub._under_way} == {2}
    hub._under_way.clear()
    hub._take(one[:-2] + b"\x86\xdd")  # of another protocol
    assert hub._under_way == []
    for pid in range(3):
        hub._pull(pid)
    assert hub.cards == {}
    hub.close()


@pytest.mark.parametrize(
    ("user", "tun", "said"), [(1000, True, "root"), (0, False, "there is no /dev/net/tun")]
)
def test_what_keeps_it_from_working_is_told(
    user: int, tun: bool, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: user)
    monkeypatch.setattr(Path, "exists", lambda self: tun)
    why = ethernet.why_not()
    assert why is not None
    assert said in why
