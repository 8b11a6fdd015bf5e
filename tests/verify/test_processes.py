"""Work in processes of its own: answers do not hang on how many there are; none is left over."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from textwrap import dedent

import pytest

from koord.syntax.diagnostics import KoordError, refusal
from koord.verify.forked import ForkedProcess
from koord.verify.job_process import Progress
from koord.verify.processes import Pool, can_fork
from tests.children import forked_children

pytestmark = pytest.mark.skipif(not can_fork(), reason="one process only")


@pytest.fixture(autouse=True)
def nobody_is_left() -> Iterator[None]:
    yield
    assert forked_children() == set()


def squared(number: int) -> Callable[[Progress], int]:
    return lambda tell: number * number


@pytest.mark.parametrize("jobs", [1, 2, 5])
def test_answers_come_in_the_order_in_which_they_are_asked_for(jobs: int) -> None:
    with Pool(jobs) as pool:
        work = {number: pool.submit("", squared(number)) for number in range(6)}
        found = [*pool.answers(work)]
        assert found == [(n, n * n) for n in range(6)]
        assert pool.answer(pool.submit("", squared(9))) == 81


@pytest.mark.parametrize("jobs", [1, 3])
def test_work_starts_with_what_is_known_when_it_is_asked_for(jobs: int) -> None:
    """What one changes no other sees."""
    known = [0]

    def counted(tell: Progress) -> int:
        known[0] += 1
        return known[0]

    with Pool(jobs) as pool:
        work = {n: pool.submit("", counted) for n in range(3)}
        found = [*pool.answers(work)]
    assert found == [(0, 1), (1, 1), (2, 1)]
    assert known == [0]


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_others_need_is_loaded_here_before_there_is_a_process(jobs: int) -> None:
    loaded: list[int] = []

    def load() -> None:
        loaded.append(os.getpid())

    with Pool(jobs) as pool:
        work = [pool.submit("", lambda tell: list(loaded), load=load) for _ in range(2)]
        found = [pool.answer(job) for job in work]
    assert found == [[os.getpid()], [os.getpid()] * 2]
    assert loaded == [os.getpid()] * 2


def test_nothing_is_loaded_for_work_that_was_dropped() -> None:
    loaded: list[int] = []
    with Pool(1) as pool:
        job = pool.submit("", squared(3))
        dropped = pool.submit("", squared(4), load=lambda: loaded.append(4))
        pool.drop(dropped)
        assert pool.answer(job) == 9
    assert loaded == []


def test_no_more_processes_than_jobs(tmp_path: Path) -> None:
    """The one that asks counts unless it waits."""
    log = tmp_path / "log"

    def logged(name: str) -> Callable[[Progress], bool]:
        def work(tell: Progress) -> bool:
            for what in ("begins", "ends"):
                with log.open("a") as file:
                    file.write(f"{name} {what}\n")
            return True

        return work

    with Pool(1) as pool:
        work = {name: pool.submit("", logged(name)) for name in "ab"}
        assert forked_children() == set()
        assert all(found for _, found in pool.answers(work))
    assert log.read_text().splitlines() == ["a begins", "a ends", "b begins", "b ends"]


def test_nobody_waits_for_the_end_of_a_process_that_has_answered_or_was_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """To give its memory back takes some milliseconds. None is left behind in the end."""
    joined: list[int] = []
    join = ForkedProcess.join

    def noted(process: ForkedProcess) -> None:
        joined.append(process.pid)
        join(process)

    monkeypatch.setattr(ForkedProcess, "join", noted)
    with Pool(2) as pool:
        assert pool.answer(pool.submit("", squared(3))) == 9
        hangs = pool.submit("", lambda tell: signal.pause())
        pool.drop(hangs)
        assert joined == []
        pool.reap()
        assert joined != []
        assert forked_children() == set()


def test_nobody_does_work_that_was_dropped(tmp_path: Path) -> None:
    touched = tmp_path / "touched"
    with Pool(1) as pool:
        dropped = pool.submit("", lambda tell: touched.touch())
        kept = pool.submit("", squared(2))
        pool.drop(dropped)
        assert pool.answer(kept) == 4
    assert not touched.exists()


def test_what_goes_wrong_in_a_process_goes_wrong_here() -> None:
    def refused(tell: Progress) -> None:
        raise refusal("K901", "file.krd", "there is no such file")

    def mistaken(tell: Progress) -> float:
        return 1 / 0

    def unsendable(tell: Progress) -> None:
        class OwnError(Exception):
            pass

        raise OwnError

    with Pool(2) as pool:
        with pytest.raises(KoordError) as refusing:
            pool.answer(pool.submit("", refused))
        assert [d.code for d in refusing.value.diagnostics] == ["K901"]
        with pytest.raises(ZeroDivisionError) as dividing:
            pool.answer(pool.submit("", mistaken))
        assert "in mistaken" in dividing.value.__notes__[0]
        with pytest.raises(RuntimeError, match="in unsendable"):
            pool.answer(pool.submit("", unsendable))


def test_of_a_process_that_dies_nothing_is_known() -> None:
    def dies(tell: Progress) -> int:
        os.kill(os.getpid(), signal.SIGKILL)
        return 0

    with Pool(2) as pool:
        work = {"dies": pool.submit("", dies), "lives": pool.submit("", squared(3))}
        found = {name: answer for name, answer in pool.answers(work)}
    assert found == {"dies": None, "lives": 9}


def test_processes_say_what_they_do() -> None:
    told: list[str] = []

    def talks(tell: Progress) -> bool:
        tell("round 1")
        return True

    with Pool(1, told.append) as pool:
        work = {name: pool.submit(name, talks) for name in ("Safe", "Live")}
        assert all(found for _, found in pool.answers(work))
    assert told == ["0 of 2 done; Safe: round 1", "1 of 2 done; Live: round 1"]


def test_on_ctrl_c_processes_say_what_they_know_by_then(tmp_path: Path) -> None:
    begun = tmp_path / "begun"

    def waits(tell: Progress) -> str:
        try:
            begun.touch()
            while True:
                signal.pause()
        except KeyboardInterrupt:
            return "known by then"

    with Pool(1, interrupted=begun.exists) as pool:
        work = {name: pool.submit(name, waits) for name in ("first", "second")}
        answers = pool.answers(work)
        assert next(answers) == ("first", "known by then")
        with pytest.raises(KeyboardInterrupt):
            next(answers)


def test_on_ctrl_c_nobody_waits_for_who_does_not_listen(tmp_path: Path) -> None:
    deaf = tmp_path / "deaf"

    def sleeps(tell: Progress) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        deaf.touch()
        while True:
            signal.pause()

    with Pool(1, interrupted=deaf.exists) as pool, pytest.raises(KeyboardInterrupt):
        pool.answer(pool.submit("", sleeps))


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel ends children of nobody else")
def test_processes_end_with_the_one_that_asks_however_it_ends() -> None:
    """All of them hold the same pipe, which closes when the last one is gone."""
    program = """
        import os, signal, time
        from koord.verify.processes import Pool

        def waits(tell):
            tell("here")
            time.sleep(600)

        with Pool(3, lambda text: os.kill(os.getpid(), signal.SIGKILL)) as pool:
            work = [pool.submit("", waits) for _ in range(3)]
            pool.answer(work[0])
    """
    done = subprocess.run(
        [sys.executable, "-c", dedent(program)], stdout=subprocess.PIPE, timeout=120, check=False
    )
    assert done.returncode == -signal.SIGKILL
