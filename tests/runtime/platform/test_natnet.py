"""The localiser of NatNet against a fake server, in virtual time; and some against processes."""

from __future__ import annotations

import math
import socket
import struct
import time
from collections.abc import Callable
from multiprocessing.connection import Connection

import pytest

pytest.importorskip("natnet", reason="pip install 'koord[natnet]'")

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.frames import yaw_of
from koord.runtime.drivers.localisers.capture import Up
from koord.runtime.drivers.localisers.natnet import NatNetLocaliser, NatNetOptions
from koord.runtime.drivers.setpoints import Located
from koord.testing.natnet import machine
from koord.testing.natnet.packets import Message, Stream, Version, packet
from koord.testing.natnet.serving import Settings
from tests.runtime.platform.autopilots import SPAWN
from tests.runtime.platform.natnets import Watched, localiser, serving
from tests.sampling import first

BODIES = ("car", "drone")
VERSIONS = [Version(3), Version(3, 1), Version(4), Version(4, 1), Version(4, 2)]
GROUP = Stream(1511, "239.255.42.99")
PATIENCE_S = 60.0


@pytest.mark.parametrize("version", VERSIONS, ids=lambda v: f"{v.major}.{v.minor}")
@pytest.mark.parametrize("stream", [Stream(), GROUP], ids=["unicast", "multicast"])
@pytest.mark.parametrize("up", list(Up), ids=lambda up: up.value)
def test_a_body_is_where_the_server_says(
    version: Version, stream: Stream, up: Up, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(P-LOCATE-NATNET) By its name, in all versions, whichever axis points up."""
    settings = Settings(BODIES, version, machine.Up(up.value), stream=stream)
    one = Watched(monkeypatch, settings, up=up.value, body="drone")
    one.network.hear(body="car", position=(9.0, 9.0, 9.0))
    one.network.hear(body="drone", position=(1.0, -2.0, 0.5), heading=0.7)
    located = one.ticks(20)
    assert located is not None
    assert located.position_m == pytest.approx((1.0, -2.0, 0.5))
    assert located.attitude is not None
    assert yaw_of(located.attitude) == pytest.approx(0.7)
    assert one.localiser.remarks == ()


def test_a_body_is_called_as_the_device_or_has_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """(P-LOCATE-CAPTURE)"""
    for options in ({}, {"number": 1}, {"body": "c{pid}r"}):
        one = Watched(monkeypatch, Settings(("car", "c2r")), **options)
        one.network.hear(body="car", position=(1.0, 0.0, 0.0))
        one.network.hear(body="c2r", position=(2.0, 0.0, 0.0))
        located = one.ticks(20)
        assert located is not None
        assert located.position_m[0] == (2.0 if "body" in options else 1.0)


def test_a_pose_counts_from_when_cameras_were_exposed(monkeypatch: pytest.MonkeyPatch) -> None:
    """(P-LOCATE-NATNET) By the server's clock, which is another one."""
    one = Watched(monkeypatch, Settings(BODIES, latency_s=0.03))
    one.network.hear(body="car", position=(1.0, 0.0, 0.0))
    one.ticks(40)
    speed_mps, begun = 2.0, one.network.now
    for _ in range(100):
        x = 1.0 + speed_mps * (one.network.now - begun)
        one.network.hear(body="car", position=(x, 0.0, 0.0))
        one.network.pass_time(0.01)
    located = one.localiser.locate(one.network.now)
    assert located is not None
    age_s = one.network.now - located.measured_at_s
    assert 0.03 - 0.003 <= age_s <= 0.03 + 0.013
    # Queues on the way make it older, and nobody takes that for new.
    one.network.way_s = 0.08
    located = one.ticks(10)
    assert located is not None
    assert one.network.now - located.measured_at_s >= 0.1


def test_who_is_not_tracked_is_where_it_was_and_that_is_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """(P-LOCATE-LOST)"""
    one = Watched(monkeypatch, Settings(BODIES))
    one.network.hear(body="car", position=(1.0, 2.0, 0.0))
    seen = one.ticks(20)
    assert seen is not None
    one.network.hear(body="car", tracked=False)
    located = one.ticks(20)
    assert located is not None
    assert located.position_m == seen.position_m
    assert one.network.now - located.measured_at_s > 0.9
    (remark,) = one.localiser.remarks
    assert "the rigid body `car` is not tracked: do cameras see its markers?" in remark
    one.network.hear(body="car", tracked=True)
    located = one.ticks(2)
    assert located is not None
    assert one.network.now - located.measured_at_s < 0.05
    assert one.localiser.remarks == ()


@pytest.mark.parametrize("trouble", ["frozen", "silent"])
@pytest.mark.parametrize("stream", [Stream(), GROUP], ids=["unicast", "multicast"])
def test_frames_that_are_the_same_or_do_not_come_make_no_pose_new(
    trouble: str, stream: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(P-LOCATE-LOST)"""
    one = Watched(monkeypatch, Settings(BODIES, stream=stream))
    one.network.hear(body="car", position=(1.0, 2.0, 0.0))
    one.ticks(20)
    one.network.hear(**{trouble: True})
    located = one.ticks(30)
    assert located is not None
    assert one.network.now - located.measured_at_s > 1.4
    (remark,) = one.localiser.remarks
    assert "no new frames come from 10.0.0.1:1510" in remark
    one.network.hear(**{trouble: False})
    located = one.ticks(2)
    assert located is not None
    assert one.network.now - located.measured_at_s < 0.05


def test_a_server_that_was_started_again_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """(P-LOCATE-LOST)"""
    one = Watched(monkeypatch, Settings(BODIES))
    one.network.hear(body="car", position=(1.0, 2.0, 0.0))
    one.ticks(20)
    one.network.server.clients.clear()
    one.network.server.capture._number = 0
    one.ticks(30)
    located = one.ticks(10)
    assert located is not None
    assert one.network.now - located.measured_at_s < 0.05


def test_a_body_that_is_not_there_is_named_with_those_that_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """(P-LOCATE-LOST)"""
    for options, called in (({"body": "cra"}, "`cra`"), ({"number": 7}, "number 7")):
        one = Watched(monkeypatch, Settings(BODIES), **options)
        assert one.ticks(20) is None
        (remark,) = one.localiser.remarks
        assert f"there is no rigid body {called}" in remark
        assert "`car` (1), `drone` (2)" in remark


@pytest.mark.parametrize("version", [Version(2, 10), Version(5)])
def test_a_version_that_is_not_read_is_named(
    version: Version, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(P-LOCATE-LOST)"""
    one = Watched(monkeypatch, Settings(BODIES, version))
    one.network.hear(body="car", position=(1.0, 2.0, 0.0))
    assert one.ticks(20) is None
    (remark,) = one.localiser.remarks
    assert f"it speaks NatNet {version.major}.{version.minor}, and 3.0 to 4.2 are read" in remark


def test_a_server_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """(P-LOCATE-LOST)"""
    one = Watched(monkeypatch, Settings(BODIES))
    one.network.hear(deaf=True)
    assert one.ticks(20) is None
    (remark,) = one.localiser.remarks
    assert "no server answers at 10.0.0.1:1510" in remark
    one.network.hear(deaf=False, body="car", position=(1.0, 2.0, 0.0))
    assert one.ticks(30) is not None


def test_no_way_to_the_server_is_an_error_with_a_cure() -> None:
    made = localiser("127.0.0.1", local="203.0.113.7")
    with pytest.raises(DriverError, match=r"no way to the NatNet server at 127.0.0.1:1510"):
        made.open(0.0)
    made = localiser("nobody.invalid")
    with pytest.raises(DriverError, match=r"no way to the NatNet server at nobody.invalid:1510"):
        made.open(0.0)


def _harmful(version: Version) -> list[bytes]:
    """Packets that are cut off, or say that there is more than there is."""
    most = b"\xff" * 4
    some = packet(Message.FRAMEOFDATA, b"\0" * 4 + most * 4)
    return [
        b"",
        b"\x07\0",
        some,
        packet(Message.FRAMEOFDATA, b"\0" * 400),
        packet(Message.FRAMEOFDATA, struct.pack("<II", 1, 0xFFFFFFFF) + b"a\0" * 40),
        packet(Message.MODELDEF, most + b"\0" * 8),
        packet(Message.MODELDEF, struct.pack("<III", 1, 0, 9) + b"a\0" + most),
        packet(Message.MODELDEF, struct.pack("<II", 1, 99)),
        packet(Message.SERVERINFO, b"a"),
        packet(Message.SERVERINFO, b"\xff" * 300),
        bytes(range(256)),
    ]


@pytest.mark.parametrize("version", VERSIONS, ids=lambda v: f"{v.major}.{v.minor}")
def test_packets_that_are_none_do_no_harm(
    version: Version, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(P-LOCATE-LOST)"""
    one = Watched(monkeypatch, Settings(BODIES, version))
    one.network.hear(body="car", position=(1.0, 2.0, 0.0))
    one.ticks(20)
    for data in _harmful(version):
        one.network.sockets[0].inbox.append(data)
        one.localiser.locate(one.network.now)
    one.ticks(30)
    located = one.ticks(1)
    assert located is not None
    assert located.position_m == (1.0, 2.0, 0.0)
    assert one.network.now - located.measured_at_s < 0.05


def test_a_position_that_is_no_number_is_passed_on_and_does_not_count(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """(P-LOCATE-POSE) See test_localised.py for what becomes of it."""
    one = Watched(monkeypatch, Settings(BODIES))
    one.network.hear(body="car", position=(1.0, 2.0, 0.0), nan=True)
    located = one.ticks(20)
    assert located is not None
    assert math.isnan(located.position_m[0])


def quaternion(axis: tuple[float, float, float], angle: float) -> tuple[float, ...]:
    x, y, z = (c * math.sin(angle / 2) for c in axis)
    return math.cos(angle / 2), x, y, z


#: What Motive shows, y up: x ahead of the room, z to its right; and the same in koord.
KNOWN = [
    # It stands as it was made known.
    (quaternion((0, 1, 0), 0.0), quaternion((0, 0, 1), 0.0)),
    # It has turned to the left: from x, which is east, away from z, which is south.
    (quaternion((0, 1, 0), math.pi / 2), quaternion((0, 0, 1), math.pi / 2)),
    # Its nose is down: the axis through its right side, z, is turned backwards.
    (quaternion((0, 0, 1), -0.3), quaternion((0, 1, 0), 0.3)),
    # It leans to the right, about the axis ahead.
    (quaternion((1, 0, 0), 0.2), quaternion((1, 0, 0), 0.2)),
]


@pytest.mark.parametrize(("seen", "known"), KNOWN)
def test_known_attitudes_of_a_capture_with_y_up(
    seen: tuple[float, float, float, float], known: tuple[float, float, float, float]
) -> None:
    """(P-LOCATE-CAPTURE)"""
    options = NatNetOptions(server="x")
    assert options.attitude(seen) == pytest.approx(known)
    assert options.position((1.0, 0.5, -3.0)) == pytest.approx((1.0, 3.0, 0.5))


def test_axes_and_origin_of_a_capture_are_placed_in_the_world() -> None:
    """(P-LOCATE-CAPTURE)"""
    options = NatNetOptions(
        server="x", up=Up.Z, origin=(10.0, 20.0, 1.0), turn=math.pi / 2, ahead=-math.pi / 2
    )
    # Its x axis is north. The body was made known while the vehicle looked along minus y.
    assert options.position((1.0, 2.0, 3.0)) == pytest.approx((8.0, 21.0, 4.0))
    assert yaw_of(options.attitude((1.0, 0.0, 0.0, 0.0))) == pytest.approx(0.0)


def until(made: NatNetLocaliser, condition: Callable[[Located | None], bool]) -> Located | None:
    """Ask it until something holds of what it says."""
    end_s = time.monotonic() + PATIENCE_S
    while not condition(located := made.locate(time.monotonic())):
        assert time.monotonic() < end_s, (located, made.remarks)
        time.sleep(0.01)
    return located


def listen(server: int, pipe: Connection) -> None:
    """A process that listens, and tells whether the car is where it is to be."""
    made = localiser("127.0.0.1", port=server)
    made.open(time.monotonic())
    until(made, lambda one: one is not None and one.position_m[0] == 3.0)
    pipe.send("seen")
    made.close()


@pytest.mark.parametrize("stream", first(1, ["unicast", "multicast"]))
def test_all_processes_of_a_machine_hear_one_server(stream: str) -> None:
    """(P-LOCATE-NATNET) The server is a process, and so are those who listen."""
    group = Stream()
    if stream == "multicast":
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            group = Stream(free.getsockname()[1], "239.255.42.99")
    with serving(Settings(BODIES, stream=group)) as server:
        made = localiser("127.0.0.1", port=server.port)
        made.open(time.monotonic())
        server.tell(body="car", position=(1.0, 2.0, 0.0))
        until(made, lambda one: one is not None)
        ours, theirs = SPAWN.Pipe()
        processes = [
            SPAWN.Process(target=listen, args=(server.port, theirs), daemon=True) for _ in range(2)
        ]
        try:
            for process in processes:
                process.start()
            server.tell(body="car", position=(3.0, 2.0, 0.0))
            until(made, lambda one: one is not None and one.position_m[0] == 3.0)
            for _ in processes:
                assert ours.poll(PATIENCE_S)
                assert ours.recv() == "seen"
        finally:
            for process in processes:
                process.kill()
                process.join()
        server.tell(body="car", tracked=False)
        until(made, lambda _: any("not tracked" in one for one in made.remarks))
        made.close()
