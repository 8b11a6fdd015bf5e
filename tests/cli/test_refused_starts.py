"""A start that is refused leaves everything as it was: no file, no folder, nothing cut short."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from koord.api import dask_cluster, deploy_run
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.deploy import supervised
from koord.runtime.deploy.local import LocalProcesses
from koord.runtime.deploy.news import News
from koord.runtime.deploy.status import unheard
from koord.runtime.transports.transport import TransportError
from koord.runtime.transports.udp import Plan, on_this_machine

UP = "allwrite:\n  int sum = 0\nUp:\n  pre: sum < 3\n  eff:\n    atomic:\n      sum = sum + 1\n"
FILES = {
    "app.krd": UP,
    "never.krd": f"param int k = 0\nassume: k > 0\n{UP}",
    "two.yaml": "agents: [{pid: 0, on_device: a}, {pid: 1, on_device: b}]\n"
    "devices:\n  a: {bot_type: IDEAL, ip: 127.0.0.1, port: 17001}\n"
    "  b: {bot_type: IDEAL, ip: 127.0.0.1, port: 17002}\n"
    "network: {transport: unicast, key: 00112233445566778899aabbccddeeff}\ndelta: 0.1\n",
    "old.mcap": "recorded before",
    "old.csv": "counted before\n",
}
FILES["far.yaml"] = FILES["two.yaml"].replace("127.0.0", "203.0.113")
FILES["zenoh.yaml"] = FILES["two.yaml"].replace("unicast", "zenoh")
FILES["keyless.yaml"] = FILES["two.yaml"].replace(", key: 00112233445566778899aabbccddeeff", "")

DEPLOYED = (
    ("app.krd zenoh.yaml --pid 0", "zenoh"),
    ("app.krd zenoh.yaml --pid 0 --fresh --state a/b --record old.mcap", "zenoh"),
    ("app.krd far.yaml --pid 0 --record new.mcap", "cannot be listened on"),
    ("app.krd far.yaml --pid 9 --record old.mcap", "no robot 9"),
    ("app.krd keyless.yaml --pid 0 --record old.mcap", "no key"),
    ("app.krd two.yaml --pid 0 --state app.krd --record old.mcap", "cannot be written"),
    ("app.krd two.yaml --all-local --state app.krd/a --record old.mcap", "cannot be written"),
    ("never.krd two.yaml --all-local --state a --record old.mcap", "K920"),
)
SIMULATED = (
    ("app.krd --html a.html --record taken.mcap", "taken.part.mcap"),
    ("never.krd --html a.html --record old.mcap --trace a.json", "K920"),
    ("never.krd --html a.html --record old.mcap --processes", "K920"),
    ("app.krd --html a.html --record none/a.mcap", "no folder"),
)
CAMPAIGNS = (
    ("never.krd --runs 2 --csv new.csv --plot a.svg", "K920"),
    ("never.krd --runs 2 --sweep k=1,2,0 --csv new.csv", "K920"),
    ("app.krd --sweep robots=2,10001 --csv new.csv", "from 1 to 10000"),
    ("app.krd --sweep k=1,2 --csv new.csv", "K236"),
    ("app.krd --runs 2 --csv old.csv --resume", "not of this campaign"),
    ("app.krd --runs 2 --csv new.csv --cluster tcp://127.0.0.1:1", "no Dask scheduler"),
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, "utf-8")
    (tmp_path / "taken.part.mcap").mkdir()
    return tmp_path


@pytest.fixture
def _no_zenoh(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "zenoh", None)


def tree(folder: Path) -> dict[str, bytes | None]:
    """All that is in a folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


@pytest.mark.usefixtures("_no_zenoh")
@pytest.mark.parametrize(
    ("command", "words", "reason"),
    [
        (command, words, reason)
        for command, cases in (("deploy", DEPLOYED), ("sim", SIMULATED), ("sim", CAMPAIGNS))
        for words, reason in cases
    ],
)
def test_a_refused_start_leaves_everything_as_it_was(
    folder: Path,
    command: str,
    words: str,
    reason: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(dask_cluster, "CONNECT_S", 0.05)
    before = tree(folder)
    assert main([command, *words.split()]) == Exit.BAD_INPUT
    assert reason in capsys.readouterr().err
    assert tree(folder) == before


def test_robots_of_which_one_cannot_begin_leave_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def half(configuration: RunConfiguration, robots: int) -> Plan:
        here = on_this_machine(robots, 27_001, group=None)
        return Plan((here.addresses[0], ("203.0.113.9", 27_002)))

    monkeypatch.setattr(deploy_run, "local_plan", half)
    before = tree(folder)
    words = [
        "app.krd",
        "two.yaml",
        "--all-local",
        "--rounds",
        "3",
        "--state",
        "a/b",
        "--record",
        "old.mcap",
    ]
    assert main(["deploy", *words]) == Exit.BAD_INPUT
    assert "cannot be listened on" in capsys.readouterr().err
    assert tree(folder) == before


def test_nothing_is_recorded_before_all_robots_can_talk(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Halves(LocalProcesses):
        """Robot 0 tells how it is doing, and then robot 1 that it cannot begin."""

        def news(self, timeout_s: float) -> Iterator[News]:
            if self.statuses:
                self.failures[1] = TransportError("robot 1 cannot begin")
                return
            self.statuses[0] = unheard(0)
            yield News(self.statuses[0])

        @property
        def is_over(self) -> bool:
            return False

    monkeypatch.setattr(supervised, "launched", Halves)
    before = tree(folder)
    words = ["app.krd", "two.yaml", "--all-local", "--record", "old.mcap"]
    assert main(["deploy", *words]) == Exit.BAD_INPUT
    assert "robot 1 cannot begin" in capsys.readouterr().err
    assert tree(folder) == before
