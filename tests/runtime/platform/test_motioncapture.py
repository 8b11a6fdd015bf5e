"""The localiser of motion captures by their library, whose reader is a process of its own."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

pytest.importorskip("motioncapture", reason="pip install 'koord[motioncapture]'")

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device
from koord.runtime.drivers.frames import yaw_of
from koord.runtime.drivers.localisers import motioncapture
from koord.runtime.drivers.localisers.motioncapture import (
    MotionCaptureLocaliser,
    MotionCaptureOptions,
)
from koord.runtime.motion.world import World
from koord.testing.natnet.packets import Stream, Version
from koord.testing.natnet.serving import Settings, serve
from tests.ports import held
from tests.runtime.platform.autopilots import running

WORLD = World((-4.0, -4.0, 0.0), (4.0, 4.0, 3.0))
PATIENCE_S = 60.0


def localiser(kind: str, **options: Any) -> MotionCaptureLocaliser:
    told = {"type": kind, "hostname": "127.0.0.1", **options}
    made = msgspec.convert(told, MotionCaptureOptions)
    device = Device(0, Vehicle("car", "CAR"), WORLD, (0.0, 0.0, 0.0), options=made)
    return MotionCaptureLocaliser(device)


def until(made: MotionCaptureLocaliser, condition: Callable[[], bool]) -> None:
    """Ask it until something holds; no question takes long, whatever the library does."""
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        made.locate(time.monotonic())
        assert time.monotonic() < end_s, made.remarks
        time.sleep(0.01)


def remark(made: MotionCaptureLocaliser) -> str:
    return "; ".join(made.remarks)


#: A reader that says lines of a file, and waits then.
SPOKEN = """\
import sys, time
print(open(sys.argv[0] + ".said").read(), flush=True)
time.sleep(1000)
"""


@pytest.fixture
def said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., MotionCaptureLocaliser]:
    """A localiser whose reader says something."""

    def make(*lines: Any, **options: Any) -> MotionCaptureLocaliser:
        script = tmp_path / "spoken.py"
        script.write_text(SPOKEN, encoding="utf-8")
        text = "\n".join(one if isinstance(one, str) else json.dumps(one) for one in lines)
        (tmp_path / "spoken.py.said").write_text(text, encoding="utf-8")
        monkeypatch.setattr(motioncapture, "_command", lambda *_: [sys.executable, str(script)])
        made = localiser("vicon", **options)
        made.open(0.0)
        return made

    return make


def test_a_pose_counts_from_when_the_library_told_it(
    said: Callable[..., MotionCaptureLocaliser],
) -> None:
    """(P-LOCATE-READER)"""
    pose = [1.0, 2.0, 0.5, 1.0, 0.0, 0.0, 0.0]
    made = said({"connected": True}, {"names": ["car"]}, "no line", {"at_s": 7.0, "pose": pose})
    until(made, lambda: made.locate(7.1) is not None)
    located = made.locate(7.1)
    assert located is not None
    assert (located.position_m, located.measured_at_s) == ((1.0, 2.0, 0.5), 7.0)
    assert made.remarks == ()
    made.locate(7.8)
    assert "the body `car` is not seen any more" in remark(made)
    made.close()


def test_a_body_that_is_not_there_is_named_with_those_that_are(
    said: Callable[..., MotionCaptureLocaliser],
) -> None:
    """(P-LOCATE-LOST)"""
    made = said({"connected": True}, {"names": ["hawk", "crow"]})
    until(made, lambda: "`hawk`, `crow`" in remark(made))
    assert "there is no body `car`" in remark(made)
    made.close()


def test_a_library_that_waits_for_ever_stops_nobody() -> None:
    """(P-LOCATE-READER) It holds the interpreter while it waits for this system."""
    made = localiser("vicon")
    made.open(time.monotonic())
    until(made, lambda: "vicon at 127.0.0.1 does not answer" in remark(made))
    begun_s = time.monotonic()
    made.close()
    assert time.monotonic() - begun_s < 5.0


@pytest.mark.parametrize(
    ("kind", "told"),
    [("foo", "Unknown motion capture type!"), ("qualisys", "Error connecting QTM")],
)
def test_what_the_library_says_is_told(kind: str, told: str) -> None:
    """(P-LOCATE-LOST)"""
    made = localiser(kind)
    made.open(time.monotonic())
    until(made, lambda: told in remark(made))
    assert "see `type` and `hostname`" in remark(made)
    made.close()


@pytest.mark.skipif(sys.platform != "linux", reason="others notice it when they say something")
def test_a_reader_ends_with_who_started_it() -> None:
    """(P-LOCATE-READER)"""
    script = (
        "import os, time\n"
        "from tests.runtime.platform.test_motioncapture import localiser\n"
        "made = localiser('vicon'); made.open(0.0); print(made._reader.pid, flush=True)\n"
        "time.sleep(1000)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, cwd=Path(__file__).parents[3]
    ) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        while "motioncapture.cpython" not in Path(f"/proc/{pid}/maps").read_text():
            time.sleep(0.01)  # it has the library by now
        parent.kill()
    end_s = time.monotonic() + PATIENCE_S
    while _is_alive(pid):
        assert time.monotonic() < end_s
        time.sleep(0.01)


def _is_alive(pid: int) -> bool:
    status = Path(f"/proc/{pid}/stat")
    try:
        return status.read_text().rpartition(")")[2].split()[0] not in ("Z", "X")
    except FileNotFoundError:
        return False


def _address() -> str | None:
    """An address of this machine through which groups are reached; None: it has none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        try:
            made.connect(("239.255.42.99", 1511))
        except OSError:
            return None
        host: str = made.getsockname()[0]
        return host


@pytest.mark.slow
@pytest.mark.parametrize("version", [Version(3), Version(4, 1)], ids=["3.0", "4.1"])
def test_the_library_reads_the_fake_server_of_natnet(version: Version) -> None:
    """It is a client of NatNet that shares nothing with koord's. (P-LOCATE-READER)"""
    interface = _address()
    if interface is None:
        pytest.skip("this machine has no network")
    settings = Settings(("car",), version, stream=Stream(1511, "239.255.42.99"))
    settings = msgspec.structs.replace(settings, interface=interface)
    with (
        held("natnet"),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as commands,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as told,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out,
    ):
        try:
            commands.bind(("127.0.0.1", 1510))  # the library knows no other
        except OSError:
            pytest.skip("somebody else serves NatNet on this machine")
        told.bind(("127.0.0.1", 0))
        with running(serve, commands, told, settings):
            where = {"body": "car", "position": [1.0, -2.0, 0.5], "heading": 0.7}
            out.sendto(json.dumps(where).encode(), told.getsockname())
            made = localiser("optitrack", up="y")
            made.open(time.monotonic())
            until(made, lambda: made.locate(time.monotonic()) is not None)
            located = made.locate(time.monotonic())
            assert located is not None
            assert located.position_m == pytest.approx((1.0, -2.0, 0.5))
            assert located.attitude is not None
            assert yaw_of(located.attitude) == pytest.approx(0.7)
            made.close()
