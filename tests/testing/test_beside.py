"""Checks side by side: each is made once, with a peer of its own; none is lost. (P-KIT-JOBS)"""

from __future__ import annotations

import socket
import sys

import pytest

from koord.testing.conformance import Finding, Subject, Verdict
from koord.testing.conformance.bench import Call
from koord.testing.conformance.beside import GROUPS, LAST, beside, judged
from koord.testing.conformance.holders import Holders, free_port, fresh, has_holder
from koord.testing.conformance.lane import Lane
from koord.testing.conformance.running import NAMES

FILLED = Holders(21000, 80, 3)


def made(
    *only: str, target: str = "tests.testing.faulty:Faulty", jobs: int = 2, cancelled: bool = False
) -> tuple[list[Finding], list[Lane]]:
    """What is found of a driver, and the lanes that were made for it."""
    lanes: list[Lane] = []

    def lane(number: int, checks: tuple[str, ...]) -> Lane:
        silent = (sys.executable, "-c", "import time; print('{}', flush=True); time.sleep(60)")
        lanes.append(Lane(Subject(target, is_virtual=True), silent, {}, checks))
        return lanes[-1]

    return list(beside(lane, jobs, only, is_cancelled=lambda: cancelled)), lanes


def test_each_check_is_in_one_group() -> None:
    in_groups = [check for group in GROUPS for check in group]
    assert sorted([*in_groups, LAST]) == sorted(NAMES)


def test_groups_keep_the_order_of_the_suite() -> None:
    for group in GROUPS:
        assert list(group) == sorted(group, key=NAMES.index)


def test_each_group_has_a_process_of_its_own() -> None:
    found, lanes = made("options", "frames", "capabilities")
    assert [one.checks for one in lanes] == [("frames",), ("options", "capabilities")]
    assert {one.check for one in found} == {"options", "frames", "capabilities"}
    assert {one.verdict for one in found if one.check == "options"} == {Verdict.PASSED}


@pytest.mark.slow
def test_a_process_that_dies_fails_its_checks() -> None:
    found, _ = made("options", "capabilities", "second", target="tests.testing.faulty:dies")
    failed = {one.check: one for one in found if one.verdict is Verdict.FAILED}
    assert set(failed) == {"capabilities", "second"}  # an option that there is not is seen before
    for one in failed.values():
        assert one.measures[-1].seen == "the process of the check ended with 3: it has died"


def test_somebody_who_asks_for_the_end_gets_it() -> None:
    found, _ = made("options", "frames", "second", jobs=1, cancelled=True)
    assert len(found) < 3


def test_calls_of_all_are_judged() -> None:
    quick = Call("sense", 0.001)
    assert judged([quick] * 99).verdict is Verdict.PASSED
    late = judged([*[quick] * 99, Call("sense", 0.3, dead=True)])
    assert late.verdict is Verdict.FAILED
    assert late.measures[-1].seen.startswith("`sense` while the other side is gone: 95 % in 300.0")


@pytest.mark.slow
def test_whether_calls_wait_can_be_asked_alone() -> None:
    ((blocks,), (lane,)) = made("blocks")
    assert (blocks.check, lane.checks) == ("blocks", ("blocks",))


def test_a_place_holder_alone_becomes_a_number() -> None:
    options = {"port": "{free}", "names": ["kit{job}", "{domain}"], "wait": 1.5}
    assert FILLED.value(options) == {"port": 21000, "names": ["kit3", 80], "wait": 1.5}
    assert FILLED.text("--port {free} --name {job}{other}") == "--port 21000 --name 3{other}"


def test_place_holders_are_found_wherever_they_are() -> None:
    assert has_holder({"a": [{"b": "udpout:127.0.0.1:{free}"}]})
    assert not has_holder({"a": ["{other}", 1, None]})


def test_nobody_gets_a_port_that_another_one_has() -> None:
    ports = {fresh().free for _ in range(50)}
    assert len(ports) == 50
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(("127.0.0.1", free_port()))
        assert bound.getsockname()[1] not in {free_port() for _ in range(50)}
