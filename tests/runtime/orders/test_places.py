"""Files by which the robots of this machine are found. (O-HERE)"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from koord.runtime.orders import places
from koord.runtime.orders.lines import Addresses, Reach, Routes
from koord.runtime.orders.places import Access, found, left

REACHES: list[Reach] = [
    Addresses(((0, ("127.0.0.1", 7000)), (3, ("10.0.0.7", 7001)))),
    Routes((0, 1), ("tcp/10.0.0.7:7447",), ()),
]

ACCESS = Access(b"key", encrypts=False, reach=REACHES[0])


@pytest.mark.parametrize("reach", REACHES)
def test_a_run_is_found_as_long_as_it_runs(tmp_path: Path, reach: Reach) -> None:
    where = tmp_path / "runs"
    with left("some/task.yaml", Access(b"\x00key", True, reach), where) as path:
        ((file, run),) = found("some/../some/task.yaml", where)
        assert (file, run.access) == (path, Access(b"\x00key", True, reach))
        assert run.is_alive
        assert found(None, where) == [(file, run)]
        assert found("other.yaml", where) == []
    assert found(None, where) == []


def test_nobody_else_can_read_them(tmp_path: Path) -> None:
    where = tmp_path / "runs"
    with left("task.yaml", ACCESS, where) as path:
        assert path is not None
        assert where.stat().st_mode & 0o777 == 0o700
        assert path.stat().st_mode & 0o777 == 0o600


def test_files_of_others_are_not_believed(tmp_path: Path) -> None:
    """Whoever could write them could have this user send orders anywhere."""
    where = tmp_path / "runs"
    with left("task.yaml", ACCESS, where) as path:
        assert path is not None
        path.chmod(0o644)
        assert found(None, where) == []
        path.chmod(0o600)
        where.chmod(0o755)
        assert found(None, where) == []
        where.chmod(0o700)
        link = where / "1-x.run"
        link.symlink_to(path)
        assert [file for file, _ in found(None, where)] == [path]


@pytest.mark.parametrize("text", ["", "{}", "[1]", "\x00" * 40])
def test_nonsense_is_no_run(tmp_path: Path, text: str) -> None:
    where = tmp_path / "runs"
    where.mkdir(mode=0o700)
    file = where / "1-x.run"
    file.write_text(text)
    file.chmod(0o600)
    assert found(None, where) == []


def test_a_folder_that_cannot_be_made_is_gone_without(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with left("task.yaml", ACCESS, tmp_path / "file/x") as path:
        assert path is None


def test_a_process_that_was_killed_is_known_to_be_gone(tmp_path: Path) -> None:
    """Its file is left."""
    where = tmp_path / "runs"
    text = (
        "import os, pathlib, sys\n"
        "from koord.runtime.orders.places import Access, left\n"
        "from koord.runtime.orders.lines import Addresses\n"
        "where = pathlib.Path(sys.argv[1])\n"
        "with left('task.yaml', Access(b'k', False, Addresses(())), where):\n"
        "    os.kill(os.getpid(), 9)\n"
    )
    subprocess.run([sys.executable, "-c", text, str(where)], check=False, timeout=60)
    ((file, run),) = found(None, where)
    assert not run.is_alive
    with left("task.yaml", ACCESS, where):
        assert file.exists(), "its robots may still be on their way to their last stop"
    os.utime(file, (0, 0))
    with left("task.yaml", ACCESS, where):
        assert not file.exists()


def test_another_process_of_its_number_is_not_it(tmp_path: Path) -> None:
    where = tmp_path / "runs"
    with left("task.yaml", ACCESS, where):
        ((_, run),) = found(None, where)
        if run.begun:
            earlier = type(run)(1, run.configuration, os.getpid(), "1", run.access)
            assert not earlier.is_alive


def test_where_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/user/1")
    assert places.folder() == Path("/run/user/1/koord")
