"""Robots that crash, lose or damage what they noted, or find that nothing can be written."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from itertools import repeat
from pathlib import Path

import pytest

from koord.runtime.deploy.slots import BLOCK_BYTES
from tests.deployed.conftest import MakeFleet
from tests.sampling import first

#: The capabilities with which root may write where nobody may.
_UNBOUND = ("setpriv", "--bounding-set=-dac_override,-dac_read_search,-fowner", "--inh-caps=-all")


def _as_a_user() -> tuple[str, ...]:
    """What a command is started with so that a read-only folder is one to it."""
    if os.geteuid() != 0:
        return ()
    if shutil.which("setpriv") is None:
        pytest.skip("to root no folder is read-only, and there is no setpriv")
    return _UNBOUND


# --- with their journals --------------------------------------------------------------------------


def test_the_coordinator_crashes_and_comes_back(fleet_of: MakeFleet) -> None:
    fleet = fleet_of(3)
    fleet.start_all()
    fleet.until_round(5)
    fleet[0].kill()
    fleet.until_further(5, 1, 2)
    fleet.again(0)
    fleet.until_further(10)
    fleet.stop()
    assert fleet.disagreements() == []
    assert fleet[0].report["ran"] > 0


@pytest.mark.parametrize("killed", first(1, [((2, 3),), ((0, 1, 2, 3),)]))
def test_as_many_as_like_crash_and_come_back(fleet_of: MakeFleet, killed: tuple[int, ...]) -> None:
    fleet = fleet_of(4)
    fleet.start_all()
    fleet.until_round(5)
    for pid in killed:
        fleet[pid].kill()
    for pid in killed:
        fleet.again(pid)
    fleet.heard_at_s("0", "1", "2", "3")
    fleet.until_further(10, within_s=5.0)
    fleet.stop()
    assert fleet.disagreements() == []
    assert all(one.report["ran"] > 0 for one in fleet)


def test_the_same_commands_after_ctrl_c_go_on(fleet_of: MakeFleet) -> None:
    fleet = fleet_of(3)
    fleet.start_all()
    fleet.until_round(5)
    fleet.stop()
    done = [one.report["round"] for one in fleet]
    for pid in range(3):
        fleet.again(pid)
    fleet.heard_at_s("0", "1", "2")
    fleet.until_further(10, within_s=5.0)
    fleet.stop()
    assert fleet.disagreements() == []
    assert [one.rounds[0].round for one in fleet] == done


def test_a_clock_that_goes_back_shuts_nobody_out(fleet_of: MakeFleet) -> None:
    fleet = fleet_of(3)
    fleet.start_all()
    fleet.until_round(5)
    fleet[2].kill()
    fleet.again(2)
    fleet.until_further(5)
    fleet[2].kill()
    fleet.again(2, clock_shift_s=-3600.0)
    fleet.heard_at_s("2")
    fleet.until_further(10, within_s=5.0)
    fleet.stop()
    assert fleet.disagreements() == []
    assert fleet[2].report["ran"] > 0


@pytest.mark.slow
def test_an_old_disk_that_is_brought_back_undoes_nothing(
    fleet_of: MakeFleet, tmp_path: Path
) -> None:
    fleet = fleet_of(3)
    fleet.start_all()
    fleet.until_round(5)
    shutil.copytree(fleet.folder / "2" / "state", tmp_path / "old")
    fleet.until_further(10)
    for pid in range(3):
        fleet[pid].kill()
    for pid in range(3):
        fleet.again(pid, **({"state": tmp_path / "old"} if pid == 2 else {}))
    fleet.heard_at_s("0", "1", "2")
    fleet.until_further(10, within_s=8.0)
    fleet.stop()
    assert fleet.disagreements() == []
    assert all(one.report["trouble"] is None for one in fleet)


@pytest.mark.slow
def test_robots_may_share_a_folder(fleet_of: MakeFleet, tmp_path: Path) -> None:
    fleet = fleet_of(3, state=tmp_path / "shared")
    fleet.start_all()
    fleet.until_round(5)
    for pid in range(3):
        fleet[pid].kill()
    for pid in range(3):
        fleet.again(pid)
    fleet.until_further(10)
    fleet.stop()
    assert fleet.disagreements() == []
    assert all(one.report["ran"] > 0 for one in fleet)


# --- without them ---------------------------------------------------------------------------------


@pytest.mark.parametrize("is_elsewhere", first(1, [False, True]))
def test_a_robot_without_its_journal_joins_mute_and_says_so(
    fleet_of: MakeFleet, tmp_path: Path, is_elsewhere: bool
) -> None:
    fleet = fleet_of(3)
    fleet.start_all()
    fleet.until_round(5)
    fleet[2].kill()
    if is_elsewhere:
        fleet.again(2, state=tmp_path / "elsewhere")
    else:
        shutil.rmtree(fleet.folder / "2" / "state")
        fleet.again(2)
    fleet.until_said(fleet[2], "journal", fleet.heard_at_s("2") + 2.0)
    fleet.until_further(10, within_s=5.0)
    fleet.stop()
    assert fleet.disagreements() == []
    assert fleet[2].report["is_mute"]
    assert fleet[2].report["ran"] == 0
    assert all(one.report["trouble"] is None for one in fleet)


def test_a_robot_that_would_begin_afresh_alone_is_refused(fleet_of: MakeFleet) -> None:
    """What it has noted is kept: without the flag it goes on."""
    fleet = fleet_of(3)
    fleet.start_all()
    fleet.until_round(5)
    fleet[2].kill()
    refused = fleet.again(2, words=("--fresh",))
    assert refused.end(5.0) == 2
    assert refused.has_said("--fresh")
    fleet.again(2, words=())
    fleet.until_further(10, within_s=5.0)
    fleet.stop()
    assert fleet.disagreements() == []
    assert fleet[2].report["ran"] > 0


# --- with damaged ones ----------------------------------------------------------------------------


def _cut_at(content: bytes, share: float) -> int:
    """A place within what was written of a journal."""
    return BLOCK_BYTES + int((len(content.rstrip(b"\0")) - BLOCK_BYTES) * share)


def _flipped(content: bytes, other: bytes) -> bytes:
    at = _cut_at(content, 0.5)
    return content[:at] + bytes((content[at] ^ 0x10,)) + content[at + 1 :]


def _emptied(content: bytes, other: bytes) -> bytes:
    return b""


def _of_another(content: bytes, other: bytes) -> bytes:
    return other


@pytest.mark.parametrize("damage", first(1, [_flipped, _emptied, _of_another]))
def test_a_damaged_journal_is_named_and_harms_nobody(
    fleet_of: MakeFleet, damage: Callable[[bytes, bytes], bytes]
) -> None:
    fleet = fleet_of(3)
    fleet.start_all()
    fleet.until_round(5)
    fleet[2].kill()
    own, others = (sorted((fleet.folder / pid / "state").iterdir()) for pid in ("2", "1"))
    for path, other in zip(own, others, strict=False):
        path.write_bytes(damage(path.read_bytes(), other.read_bytes()))
    fleet.again(2)
    fleet.until_said(fleet[2], "journal", fleet.heard_at_s("2") + 2.0)
    fleet.until_further(10, within_s=5.0)
    fleet.stop()
    assert fleet.disagreements() == []
    assert all(one.report["trouble"] is None for one in fleet)


@pytest.mark.slow
@pytest.mark.parametrize("kept", [0.3, 0.6, 0.9])
def test_a_journal_that_lacks_its_end_is_as_an_old_one(fleet_of: MakeFleet, kept: float) -> None:
    fleet = fleet_of(3)
    fleet.start_all()
    fleet.until_round(15)
    fleet[2].kill()
    for path in (fleet.folder / "2" / "state").iterdir():
        os.truncate(path, _cut_at(path.read_bytes(), kept))
    fleet.again(2)
    fleet.until_further(10, within_s=5.0)
    fleet.stop()
    assert fleet.disagreements() == []
    assert all(one.report["trouble"] is None for one in fleet)


# --- nothing can be written -----------------------------------------------------------------------


@pytest.mark.skipif(sys.platform != "linux", reason="limits of other processes are Linux's")
def test_a_full_disk_is_waited_for(fleet_of: MakeFleet) -> None:
    fleet = fleet_of(3)
    fleet.start(0)
    fleet.start(1)
    fleet.start(2, records=False)
    fleet.until_round(5, 0, 1)
    fleet[2].fill_disk()
    fleet.until(lambda: fleet[2].has_said("journal|disk"), "told", 3.0)
    fleet.until_further(10, 0, 1, within_s=5.0)
    assert fleet[2].is_alive
    freed = fleet.round
    fleet[2].free_disk()
    fleet.until_further(20, 0, 1)
    fleet.stop()
    assert fleet.disagreements() == []
    ended = fleet[2].report
    assert ended["trouble"] is None
    assert not ended["is_mute"]
    assert ended["round"] > freed + 10
    assert ended["ran"] > 10


@pytest.mark.slow
def test_a_file_system_without_room_is_waited_for(fleet_of: MakeFleet, tmp_path: Path) -> None:
    """As above, with a file system of its own: a journal that has its room needs no more of it."""
    folder = tmp_path / "small"
    folder.mkdir()
    taken = 'head -c 1048576 /dev/zero >"$0/ballast"'
    mounted = f'mount -t tmpfs -o size=2m none "$0" && {taken} && exec "$@"'
    before = ("unshare", "-rm", "sh", "-c", mounted, str(folder))
    tried = subprocess.run([*before, "true"], capture_output=True, check=False)
    if tried.returncode != 0:
        pytest.skip("file systems cannot be mounted here")
    fleet = fleet_of(3)
    fleet.start(0)
    fleet.start(1)
    small = fleet.start(2, state=folder, before=before, records=False)
    fleet.until(lambda: small.has_said("journal.*No space left"), "told", 5.0)
    ballast = Path(f"/proc/{small.process.pid}/root/{folder}/ballast")
    ballast.unlink()
    fleet.until_round(5, 0, 1)  # who begins waits for all
    with ballast.open("wb", buffering=0) as file, pytest.raises(OSError, match="No space left"):
        file.writelines(repeat(bytes(512)))
    filled = fleet.round
    fleet.until_further(20, 0, 1)
    fleet.stop()
    assert fleet.disagreements() == []
    assert small.report["trouble"] is None
    assert not small.report["is_mute"]
    assert small.report["round"] > filled + 10


def test_a_folder_that_nobody_may_write_to_is_named(fleet_of: MakeFleet, tmp_path: Path) -> None:
    before = _as_a_user()
    folder = tmp_path / "read-only"
    folder.mkdir(mode=0o500)
    fleet = fleet_of(1)
    one = fleet.start(0, state=folder, before=before)
    fleet.until(lambda: one.has_said("journal.*(read-only|denied)"), "named", 5.0)
    assert "Traceback" not in one.err
    folder.chmod(0o700)
    if not one.is_alive:  # it may have waited, or have left
        assert one.process.returncode == 2
        fleet.again(0)
    fleet.until_round(5)


# --- signals --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("number", "code"), first(1, [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
)
def test_robots_that_are_asked_to_end_have_recorded_all(
    fleet_of: MakeFleet, number: signal.Signals, code: int
) -> None:
    fleet = fleet_of(1)
    one = fleet.start(0)
    fleet.until_round(5)
    one.signal(number)
    assert one.end() == code
    assert [said.round for said in one.rounds] == list(range(-1, one.report["round"]))
