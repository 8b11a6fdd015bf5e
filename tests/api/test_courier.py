"""A cluster answers as processes of this machine do, whoever dies, and not for who has ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from koord.api import courier
from koord.api.courier import Cluster, cluster_at
from koord.syntax.diagnostics import KoordError
from koord.verify.helpers import Helpers, Parcel, PortableWork
from koord.verify.processes import Pool, can_fork
from tests.clusters import Dying, Pipes, Refused, Squared, local_cluster

pytest.importorskip("distributed")
pytestmark = pytest.mark.skipif(not can_fork(), reason="one process only")


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with local_cluster() as (found, _):
        yield found


@pytest.fixture(scope="module")
def cluster(address: str) -> Iterator[Cluster]:
    with cluster_at(address, lambda text: None, lambda: False) as found:
        yield found


def asked(pool: Pool, work: PortableWork, name: str = "") -> object:
    return pool.answer(pool.submit(name, work, portable=work))


@pytest.mark.parametrize("jobs", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_answers_come_in_the_order_in_which_they_are_asked_for(cluster: Cluster, jobs: int) -> None:
    with Pool(jobs, helpers=cluster.helpers) as pool:
        questions = {n: Squared(n) for n in range(4)}
        work = {n: pool.submit("", q, portable=q) for n, q in questions.items()}
        work |= {n: pool.submit("", Squared(n)) for n in range(4, 6)}  # which is not sent
        assert [*pool.answers(work)] == [(n, n * n) for n in range(6)]


@pytest.mark.slow
def test_what_goes_wrong_there_goes_wrong_here(cluster: Cluster) -> None:
    with Pool(helpers=cluster.helpers) as pool:
        with pytest.raises(KoordError) as refused:
            asked(pool, Refused(False))
        assert [d.code for d in refused.value.diagnostics] == ["K901"]
        with pytest.raises(ZeroDivisionError) as dividing:
            asked(pool, Refused(True))
        assert "clusters.py" in dividing.value.__notes__[0]


@pytest.mark.slow
def test_a_process_that_dies_there_dies_as_one_here(cluster: Cluster) -> None:
    ends, notes = [], []
    for helpers in (None, cluster.helpers):
        with Pool(helpers=helpers) as pool:
            job = pool.submit("", Dying(), portable=Dying())
            assert pool.answer(job) is None
            ends.append(job.end)
            notes.append(job.noted)
    assert ends == ["its process was ended by SIGKILL, as for want of memory"] * 2
    assert notes == [["soon dead"]] * 2


def test_a_question_of_a_worker_that_dies_is_asked_again(address: str, tmp_path: Path) -> None:
    pipes, told = Pipes.at(tmp_path), list[str]()
    question = pipes.held(7)
    with (
        cluster_at(address, told.append, lambda: False) as cluster,
        Pool(1, told.append, helpers=cluster.helpers) as pool,
    ):
        job = pool.submit("held", question, portable=question)
        with pipes.begins.open() as begins:
            worker = int(begins.readline().split()[0])
            os.kill(worker, signal.SIGKILL)
            assert begins.read() == "", "the question ends with its worker"
        with pipes.begins.open() as begins:
            assert int(begins.readline().split()[0]) != worker
        pipes.go_on()
        assert pool.answer(job) == 7
        assert job.noted == ["begun"], "what the first one told of is as good as untold"
    assert cluster.died == 1
    assert sum(text.startswith("held: on tcp://") for text in told) == 2


@pytest.mark.slow
def test_what_is_dropped_ends_there(cluster: Cluster, tmp_path: Path) -> None:
    pipes = Pipes.at(tmp_path)
    question = pipes.held(7)
    with Pool(helpers=cluster.helpers) as pool:
        job = pool.submit("", question, portable=question)
        with pipes.begins.open() as begins:
            assert begins.readline()
            pool.drop(job)
            assert begins.read() == "", "it ends when its process does"
        assert asked(pool, Squared(3)) == 9


@pytest.mark.slow
def test_a_question_does_not_outlive_who_asks(address: str, tmp_path: Path) -> None:
    pipes = Pipes.at(tmp_path)
    asking = subprocess.Popen(
        [
            *(sys.executable, "-c"),
            "import sys\n"
            "from koord.api.courier import cluster_at\n"
            "from koord.verify.processes import Pool\n"
            "from tests.clusters import Held\n"
            "question = Held(*sys.argv[2:], 7)\n"
            "with cluster_at(sys.argv[1], lambda text: None, lambda: False) as cluster:\n"
            "    with Pool(helpers=cluster.helpers) as pool:\n"
            "        pool.answer(pool.submit('', question, portable=question))\n",
            *(address, str(pipes.begins), str(pipes.goes_on)),
        ]
    )
    with asking, pipes.begins.open() as begins:
        assert begins.readline()
        asking.kill()
        assert begins.read() == ""


@pytest.mark.slow
def test_a_lost_scheduler_is_told() -> None:
    with (
        local_cluster() as (address, process),
        cluster_at(address, lambda text: None, lambda: False) as cluster,
        Pool(helpers=cluster.helpers) as pool,
    ):
        assert asked(pool, Squared(2)) == 4
        process.kill()
        with pytest.raises(KoordError, match="connection to the cluster is lost") as lost:
            asked(pool, Squared(3))
    assert [d.code for d in lost.value.diagnostics] == ["K935"]
    assert lost.value.diagnostics[0].hint


def test_a_courier_that_ended_is_told() -> None:
    with pytest.raises(KoordError, match="connection to the cluster is lost"):
        Helpers("/nowhere", b"key", "code").ask(Squared(2))


def test_other_code_gives_no_answers(cluster: Cluster) -> None:
    other = Helpers(cluster.helpers.socket, cluster.helpers.key, "koord 0.0.1")
    with (
        Pool(helpers=other) as pool,
        pytest.raises(KoordError, match=r"this is koord 0\.0\.1") as no,
    ):
        asked(pool, Squared(2))
    assert [d.code for d in no.value.diagnostics] == ["K947"]


@pytest.mark.slow
def test_a_parcel_that_came_damaged_or_to_others_is_not_opened() -> None:
    parcel = Parcel.of(Squared(2), "code")
    assert parcel.checked("code") == parcel.content
    with pytest.raises(KoordError, match="has other, and this is code"):
        parcel.checked("other")
    with pytest.raises(KoordError, match="damaged"):
        Parcel(parcel.code, parcel.digest, parcel.content + b" ").checked("code")


@pytest.mark.slow
def test_each_worker_has_to_have_koord() -> None:
    class Client:
        def __init__(self, *found: object) -> None:
            self.found = found

        def get_versions(self, packages: list[str]) -> object:
            assert packages == ["koord"]
            return {"workers": {f"tcp://{n}:1": each for n, each in enumerate(self.found)}}

    there: object = {"packages": {"koord": "0.1.0"}}
    missing: object = {"packages": {"koord": None}}
    assert courier._checked(Client(there, there)) == 2
    assert courier._checked(Client()) == 0
    for other in (missing, {"packages": {}}, "it does not answer"):
        with pytest.raises(KoordError, match="tcp://1:1 of the cluster cannot answer") as no:
            courier._checked(Client(there, other))
        assert [d.code for d in no.value.diagnostics] == ["K947"]


@pytest.mark.slow
def test_where_nobody_is_is_told() -> None:
    with (
        pytest.raises(KoordError, match="there is no Dask scheduler at nonsense") as nobody,
        cluster_at("nonsense", lambda text: None, lambda: False),
    ):
        pass
    assert [d.code for d in nobody.value.diagnostics] == ["K935"]
