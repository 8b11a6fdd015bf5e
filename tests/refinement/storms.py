"""Deployed robots for minutes on a bad Ethernet, coordinators killed meanwhile, and all judged."""

from __future__ import annotations

import multiprocessing
import time
from collections import Counter
from collections.abc import Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path
from tempfile import TemporaryDirectory

from msgspec import Struct

from koord.refinement.deployed import Expedition, spare
from koord.refinement.instrumented_robot import InstrumentedRobot
from koord.refinement.judging import Judged, judge
from koord.refinement.reports import Acted, Coordinated, Told
from koord.runtime.chaos.network import Faults
from koord.runtime.deploy.job import Job
from koord.runtime.deploy.local import Launch, LocalProcesses, launched
from tests.refinement.ethernet import BadHub, plan, plugged_in

#: The first coordinator is killed after so long.
_SETTLE_S = 4.0

#: Processes that have not begun after so long do not begin.
_BEGIN_S = 20.0


class Stormy(Struct, frozen=True):
    """How robots fared. ``successions`` are seconds from a coordinator's death to a decision."""

    rounds: int  #: that any robot acted on, INIT not counted
    took_s: float
    kills: int
    successions: tuple[float, ...]
    judged: Judged


def storm(
    expedition: Expedition, faults: Faults, lasts_s: float, kill_every_s: float | None = None
) -> Stormy:
    """Let robots run in namespaces of their own, for so long or until all have stopped.

    The coordinator's process is killed soon, and then every so often, and started anew. Raises
    DisagreementError, TransportError, OSError.
    """
    with TemporaryDirectory() as name:
        folder = Path(name)
        job = expedition.job(folder, float(expedition.system.delta_s))
        starts = expedition.starts()

        def make(job: Job, pid: int) -> InstrumentedRobot:
            return expedition.member(job, pid, starts, expedition.part(folder, pid).tell)

        hub = BadHub(folder / "hub", faults, expedition.seed)
        fork = multiprocessing.get_context("fork")
        carrying = fork.Process(target=hub.run, daemon=True)
        carrying.start()
        fleet = launched(
            Launch(
                job,
                plan(job.robots),
                make,
                lambda shared, pid: plugged_in(hub.path, shared, pid),
            )
        )
        try:
            killed = _watched(fleet, carrying, lasts_s, kill_every_s)
        finally:
            fleet.kill()
            fleet.join()
            carrying.kill()
            carrying.join()
            hub.close()
        told = expedition.told(folder)
    first, last, rounds = _span(told)
    return Stormy(
        rounds,
        max(last - first, 1e-9),
        len(killed),
        tuple(_successions(killed, told)),
        judge(expedition.ran(told)),
    )


def _watched(
    fleet: LocalProcesses, hub: BaseProcess, lasts_s: float, kill_every_s: float | None
) -> list[tuple[int, float]]:
    """Who was killed, and when."""
    begun = time.monotonic()
    # The first one soon, since robots of some programs stop before long.
    killed_at = begun + _SETTLE_S - (kill_every_s or 0.0)
    killed: list[tuple[int, float]] = []
    is_told = False
    while not fleet.is_over:
        for _ in fleet.news(0.05):
            pass
        fleet.check()
        if not hub.is_alive():
            raise OSError("the hub has fallen over")
        now = time.monotonic()
        if now - begun > lasts_s and not is_told:
            is_told = True
            fleet.stop()
        if now - begun > lasts_s + _BEGIN_S:
            break
        if kill_every_s is not None and now - killed_at > kill_every_s and not is_told:
            coordinator = _coordinator(fleet)
            if coordinator is not None and spare(fleet) > 0:
                killed_at = time.monotonic()
                fleet.replace(coordinator)
                killed.append((coordinator, killed_at))
    return killed


def _coordinator(fleet: LocalProcesses) -> int | None:
    """Whom most robots follow."""
    followed = Counter(status.coordinator for status in fleet.statuses.values())
    return followed.most_common(1)[0][0] if followed else None


def _span(told: Sequence[Sequence[Told]]) -> tuple[float, float, int]:
    """When the first and the last round were decided, and how many were acted on."""
    times = [one.at_s for story in told for one in story if isinstance(one, Coordinated)]
    acted = [one.decision.round for story in told for one in story if isinstance(one, Acted)]
    return min(times, default=0.0), max(times, default=0.0), max(acted, default=-1) + 1


def _successions(killed: list[tuple[int, float]], told: Sequence[Sequence[Told]]) -> list[float]:
    """How long nobody decided anything after each death."""
    found = []
    for robot, at_s in killed:
        after = (
            one.at_s
            for pid, story in enumerate(told)
            for one in story
            if isinstance(one, Coordinated) and pid != robot and one.at_s > at_s
        )
        later = min(after, default=None)
        if later is not None:
            found.append(later - at_s)
    return found
