"""Runs are handed out to workers, who may die; rows do not hang on who makes which."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest
from msgspec import Struct
from msgspec.structs import replace

from koord.api import campaign_workers
from koord.api.campaign import CampaignBegun, RunOver, campaign
from koord.api.campaign_runs import Order, Row
from koord.api.campaign_workers import LostError, Made, Team, _Cluster, rows_of
from koord.api.fitting import fit_request
from koord.api.progress import Progress
from koord.syntax.diagnostics import KoordError
from tests.clusters import local_cluster

PROGRAM = Path(__file__).parents[2] / "specs" / "examples" / "follow_path.krd"


def orders(count: int, time_s: float = 0.1) -> list[Order]:
    request = fit_request(PROGRAM, None, None, None, 0, None)
    return [Order(replace(request, seed=s), None, time_s, False, "") for s in range(count)]


def timeless(rows: Sequence[Row]) -> list[Row]:
    return sorted(
        (replace(row, wall_s=0.0, cpu_s=0.0, memory_mib=0.0, threads=0) for row in rows),
        key=lambda row: row.seed,
    )


class Deadly(Team):
    """A worker of this process, which says that it died where it is told to."""

    def __init__(self, dies: Callable[[Sequence[campaign_workers.Order[Any]]], bool]) -> None:
        self._dies = dies
        self.given: list[list[int]] = []

    @property
    def workers(self) -> int:
        return 2

    def submit(self, orders: Sequence[campaign_workers.Order[Any]]) -> Any:
        self.given.append([order.key[1] for order in orders])
        assert len(self.given) < 100, "the same again and again"
        future: Future[Made | None] = Future()
        future.set_result(None if self._dies(orders) else campaign_workers._made(orders))
        return future

    def made(self, future: Any) -> Made:
        found = future.result()
        if found is None:
            raise LostError("it died")
        assert isinstance(found, Made)
        return found

    def close(self, unfinished: Sequence[Any]) -> None:
        pass


def by(team: Team, count: int) -> list[Row]:
    found = [*campaign_workers._by_team(iter(orders(count)), team, lambda: False, count)]
    assert all(isinstance(row, Row) for row in found)
    return timeless([row for row in found if isinstance(row, Row)])


def test_what_a_dead_worker_was_at_is_made_once_by_others() -> None:
    rows = timeless([*rows_of(orders(12), 1, None, lambda: False)])
    times: Counter[int] = Counter()

    def twice(batch: Sequence[campaign_workers.Order[Any]]) -> bool:
        seeds = {order.key[1] for order in batch}
        times.update(seeds & {0, 5, 11})
        return any(times[seed] <= 2 for seed in seeds & {0, 5, 11})

    team = Deadly(twice)
    assert by(team, 12) == rows
    assert len(team.given) > 6


def test_a_run_by_which_workers_die_is_told_and_the_others_are_made() -> None:
    team = Deadly(lambda batch: any(order.key[1] == 20 for order in batch))
    seeds = list[int]()

    def make() -> None:
        for row in campaign_workers._by_team(iter(orders(40)), team, lambda: False, 40):
            assert isinstance(row, Row)
            seeds.append(row.seed)

    with pytest.raises(
        KoordError, match="whoever makes the run with seed 20 ends: it died"
    ) as told:
        make()
    assert set(seeds) >= set(range(10))
    assert [one.code for one in told.value.diagnostics] == ["K948"]
    assert [batch for batch in team.given if 20 in batch][-2:] == [[20], [20]]


def test_many_short_runs_are_handed_out_together() -> None:
    team = Deadly(lambda batch: False)
    by(team, 60)
    assert len(team.given) < 30
    assert len(team.given[-1]) <= len(team.given[-3])  # at the end none has all that is left


@pytest.mark.slow
def test_a_killed_process_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = timeless([*rows_of(orders(12, 2.0), 1, None, lambda: False)])
    teams: list[campaign_workers._Processes] = []
    made = campaign_workers._Processes

    def noted(count: int, prepare: Callable[[], None]) -> Team:
        teams.append(made(count, prepare))
        return teams[-1]

    monkeypatch.setattr(campaign_workers, "_Processes", noted)
    found = list[Row]()
    for row in rows_of(orders(12, 2.0), 2, None, lambda: False):
        if not found:
            os.kill(next(iter(teams[0]._pool._processes)), signal.SIGKILL)
        found.append(row)
    assert timeless(found) == rows


@pytest.mark.slow
def test_a_killed_worker_of_a_cluster_is_not_missed() -> None:
    distributed = pytest.importorskip("distributed")
    rows = timeless([*rows_of(orders(12, 2.0), 1, None, lambda: False)])
    with local_cluster(2) as (address, _), distributed.Client(address) as client:
        found = list[Row]()
        for row in rows_of(orders(12, 2.0), 1, address, lambda: False):
            if not found:
                os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)
            found.append(row)
    assert timeless(found) == rows


@pytest.mark.slow
def test_a_cluster_that_goes_away_is_told() -> None:
    pytest.importorskip("distributed")
    with local_cluster(1) as (address, process):
        made = rows_of(orders(400, 2.0), 1, address, lambda: False)
        next(made)
        process.kill()
        with pytest.raises(KoordError, match="any more"):
            list(made)


@pytest.mark.slow
def test_a_campaign_goes_on_after_its_cluster_has_gone(tmp_path: Path) -> None:
    """On another cluster, which goes away as well, and then without one; no run is made twice."""
    pytest.importorskip("distributed")
    table, whole, count = tmp_path / "runs.csv", tmp_path / "whole.csv", 30
    wanted: dict[str, Any] = {"runs": count, "seed": 0, "duration_s": 2.0}
    kept = list[list[str]]()
    for resume in (False, True):
        with local_cluster(2) as (address, process):

            def fall(progress: Progress, process: Any = process) -> None:
                if isinstance(progress, RunOver) and progress.done == 5 * (1 + len(kept)):
                    process.kill()

            with pytest.raises(KoordError, match="any more"):
                campaign(
                    PROGRAM, cluster=address, csv=table, resume=resume, progress=fall, **wanted
                )
        kept.append(table.read_text("utf-8").splitlines())
        assert 5 * len(kept) < len(kept[-1]) < 1 + count
    # Rows are kept as they come, and those that are known are put in order at the next start.
    assert kept[1][0] == kept[0][0]
    assert set(kept[0]) <= set(kept[1])
    assert len(set(kept[1])) == len(kept[1])
    heard = list[Progress]()
    campaign(PROGRAM, csv=table, resume=True, progress=heard.append, **wanted)
    (begun,) = (one for one in heard if isinstance(one, CampaignBegun))
    assert begun.known == len(kept[1]) - 1
    campaign(PROGRAM, csv=whole, **wanted)
    assert set(kept[1]) <= set(table.read_text("utf-8").splitlines())
    without_times = [
        [line.rsplit(",", 4)[0] for line in file.read_text("utf-8").splitlines()]
        for file in (table, whole)
    ]
    assert without_times[0] == without_times[1]


class Asked:
    """A future of a cluster: what comes of asking it for its exception."""

    status = "finished"

    def __init__(self, raised: Exception | None, told: Exception | None) -> None:
        self.raised, self.told = raised, told

    def exception(self) -> Exception | None:
        if self.raised is not None:
            raise self.raised
        return self.told


class Connected:
    """A client of a cluster whose scheduler answers, or not."""

    def __init__(self, *, answers: bool) -> None:
        self.answers, self.scheduler = answers, self

    def identity(self) -> None:
        pass

    def sync(self, asked: Callable[[], None], callback_timeout: float) -> None:
        if not self.answers:
            raise TimeoutError(f"no answer in {callback_timeout} s")
        asked()


def cluster(*, answers: bool = False) -> _Cluster:
    """A cluster that nobody has connected to."""
    found = _Cluster.__new__(_Cluster)
    found._address = "tcp://127.0.0.1:8786"
    found._client = Connected(answers=answers)
    return found


ENDED = [ConnectionResetError("by peer"), TimeoutError("no answer"), CancelledError()]


@pytest.mark.parametrize("raised", ENDED)
def test_a_connection_that_ends_while_it_is_asked_is_told(raised: Exception) -> None:
    with pytest.raises(KoordError, match="any more"):
        cluster().made(Asked(raised, None))


@pytest.mark.parametrize("raised", ENDED)
def test_what_is_lost_while_the_scheduler_is_there_is_made_again(raised: Exception) -> None:
    """A worker ended, and with it what it had made and had not handed over."""
    with pytest.raises(LostError):
        cluster(answers=True).made(Asked(raised, None))
    lost = Asked(None, None)
    lost.status = "lost"
    with pytest.raises(LostError):
        cluster(answers=True).made(lost)
    with pytest.raises(KoordError, match="any more"):
        cluster().made(lost)


def test_what_a_run_raises_is_not_said_of_the_cluster() -> None:
    with pytest.raises(OSError, match="no space"):
        cluster().made(Asked(None, OSError("no space")))


# --- processes that are forked --------------------------------------------------------------------

#: What a process has prepared that makes orders; those that it forks have it, too.
PREPARED = list[int]()


class Telling(Struct, frozen=True):
    """An order that tells who makes it, and what that process has."""

    number: int

    @property
    def key(self) -> tuple[str, int]:
        return "", self.number

    @property
    def words(self) -> str:
        return f"order {self.number}"

    def prepare(self) -> None:
        PREPARED.append(self.number)

    def make(self, is_enough: Callable[[], bool]) -> list[object]:
        handlers = [signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGINT)]
        quiet = handlers == [signal.SIG_DFL, signal.SIG_IGN]
        return [self.number, os.getpid(), [*PREPARED], quiet]


def asked(monkeypatch: pytest.MonkeyPatch, *, forked: bool) -> list[list[Any]]:
    monkeypatch.setattr(campaign_workers, "_can_fork", lambda: forked)
    PREPARED.clear()
    before = signal.signal(signal.SIGTERM, lambda *_: None)
    try:
        return sorted(rows_of([Telling(k) for k in range(6)], 2, None, lambda: False))
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.skipif(sys.platform != "linux", reason="forks are safe on Linux alone")
def test_forked_processes_have_what_was_prepared_once(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(monkeypatch, forked=True)
    assert [one[0] for one in found] == [*range(6)]
    assert os.getpid() not in {one[1] for one in found}
    assert [one[2] for one in found] == [[0]] * 6
    assert all(one[3] for one in found)


@pytest.mark.slow
def test_fresh_processes_prepare_for_themselves(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(monkeypatch, forked=False)
    assert [one[0] for one in found] == [*range(6)]
    assert [one[2] for one in found] == [[]] * 6
    assert PREPARED == []


def test_a_process_with_threads_is_not_forked() -> None:
    over = threading.Event()
    thread = threading.Thread(target=over.wait)
    thread.start()
    try:
        assert not campaign_workers._can_fork()
    finally:
        over.set()
        thread.join()


def _wait(line: Any, ours: Any) -> None:
    campaign_workers._begin_worker(line, ours)
    threading.Event().wait()


@pytest.mark.skipif(sys.platform != "linux", reason="forks are safe on Linux alone")
def test_forked_processes_end_with_who_asks() -> None:
    """Also where another one has the end of its line that it had when it was forked."""
    context = get_context("fork")
    line, ours = context.Pipe(duplex=False)
    workers = [context.Process(target=_wait, args=(line, ours)) for _ in range(2)]
    for worker in workers:
        worker.start()
    ours.close()
    for worker in workers:
        worker.join(60.0)
        code = worker.exitcode
        worker.kill()
        assert code == -signal.SIGTERM
