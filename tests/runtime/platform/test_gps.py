"""The localiser of GPS: what receivers say, as metres, from every source."""

from __future__ import annotations

import json
import socket
from typing import Any

import msgspec
import pytest

pytest.importorskip("pymap3d", reason="pip install 'koord[gps]'")
pytest.importorskip("pynmea2", reason="pip install 'koord[gps]'")

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.localisers.gps import GpsLocaliser, GpsOptions
from koord.runtime.drivers.localisers.gps_sources import (
    GeoFix,
    GpsdSource,
    MavlinkSource,
    NmeaSource,
    Source,
    TopicSource,
)
from koord.runtime.drivers.ros.options import Wire
from koord.runtime.motion.world import World

WORLD = World((-40.0, -40.0, 0.0), (40.0, 40.0, 30.0))

#: Metres in a hundred-thousandth of a degree on the equator: along it, and along a meridian.
EAST_M, NORTH_M = 1.113195, 1.105743


class Said:
    """A source that says what a test lets it say."""

    why_silent = "nothing comes"

    def __init__(self, *fixes: GeoFix) -> None:
        self.fixes = list(fixes)

    def take(self) -> GeoFix | None:
        return self.fixes.pop(0) if self.fixes else None

    def close(self) -> None:
        return


def localiser(by: Source | None, kind: str = "QUAD", **options: Any) -> GpsLocaliser:
    told = {"origin": [0.0, 10.0, 100.0], "source": "nmea", **options}
    made = msgspec.convert(told, GpsOptions)
    device = Device(0, Vehicle("hawk", kind), WORLD, (0.0, 0.0, 0.0), options=made)
    return GpsLocaliser(device, by)


def test_a_position_is_metres_east_north_and_up_of_the_origin() -> None:
    """(P-LOCATE-GPS)"""
    made = localiser(Said(GeoFix(True, 2e-5, 10.00003, 105.0)), latency=0.1)
    made.open(0.0)
    located = made.locate(1.0)
    assert located is not None
    assert located.position_m == pytest.approx((3 * EAST_M, 2 * NORTH_M, 5.0), abs=1e-4)
    assert located.attitude is None
    assert located.measured_at_s == 0.9
    assert made.remarks == ()


def test_degrees_of_longitude_are_shorter_in_the_north() -> None:
    """(P-LOCATE-GPS) At 60° they have half their length, and a little more on the ellipsoid."""
    made = localiser(Said(GeoFix(True, 60.0, 25.00001, 0.0)), origin=[60.0, 25.0, 0.0])
    made.open(0.0)
    located = made.locate(1.0)
    assert located is not None
    assert located.position_m[0] == pytest.approx(0.558, abs=1e-3)


def test_what_drives_is_on_the_ground_whatever_its_receiver_says() -> None:
    """(P-LOCATE-GPS)"""
    for height in (117.0, None):
        made = localiser(Said(GeoFix(True, 1e-5, 10.0, height)), "CAR")
        made.open(0.0)
        located = made.locate(1.0)
        assert located is not None
        assert located.position_m == pytest.approx((0.0, NORTH_M, 0.0), abs=1e-4)


def test_what_is_no_fix_does_not_count_and_is_told() -> None:
    """(P-LOCATE-GPS)"""
    fixed, lost = GeoFix(True, 1e-5, 10.0, 101.0), GeoFix(is_fixed=False)
    made = localiser(Said(fixed, lost, GeoFix(True, 1e-5, 10.0, None)))
    made.open(0.0)
    located = made.locate(1.0)
    assert made.locate(1.2) == located
    assert "has no fix" in made.remarks[0]
    assert made.locate(1.4) == located
    assert "tells no height" in made.remarks[0]
    made = localiser(Said(fixed))
    made.open(0.0)
    made.locate(1.0)
    made.locate(3.5)
    assert made.remarks == ("gps: nothing comes",)


def sentence(text: str) -> bytes:
    checksum = 0
    for character in text.encode():
        checksum ^= character
    return f"${text}*{checksum:02X}\r\n".encode()


GGA = sentence("GPGGA,123519,0000.0060,N,01000.0120,E,4,08,0.9,101.5,M,46.9,M,,")


def test_sentences_of_nmea() -> None:
    source = NmeaSource("udpin:127.0.0.1:0")
    assert source._socket is not None
    there = source._socket.getsockname()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        assert source.take() is None
        out.sendto(GGA, there)
        fix = source.take()
        assert fix is not None
        assert (fix.latitude_deg, fix.longitude_deg) == pytest.approx((1e-4, 10.0002))
        assert (fix.is_fixed, fix.height_m) == (True, 101.5)
        none = sentence("GPGGA,123519,,,,,0,00,,,M,,M,,")
        out.sendto(GGA + none, there)
        assert source.take() == GeoFix(is_fixed=False)
        for wrong in (
            b"\xff\xfe\n",
            GGA.replace(b"101.5", b"999.9"),
            sentence("GPGGA,1,2,3"),
            sentence("GPGGA,123519,abc,N,01000.0120,E,1,08,0.9,101.5,M,46.9,M,,"),
            sentence("GPVTG,054.7,T,034.4,M,005.5,N,010.2,K"),
            b"$" * 20000,
        ):
            out.sendto(wrong, there)
            assert source.take() is None
    source.close()


def test_reports_of_gpsd() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        source = GpsdSource(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        daemon, _ = server.accept()
        with daemon:
            assert daemon.recv(200).startswith(b"?WATCH=")
            told = {"class": "TPV", "mode": 3, "lat": 1e-4, "lon": 10.5, "altHAE": 99.0}
            line = json.dumps(told).encode() + b"\n"
            daemon.sendall(b'{"class":"VERSION"}\n' + line[:20])
            assert source.take() is None
            daemon.sendall(line[20:])
            assert _waited(source) == GeoFix(True, 1e-4, 10.5, 99.0)
            daemon.sendall(b'{"class":"TPV","mode":1}\n')
            assert _waited(source) == GeoFix(is_fixed=False)
            daemon.sendall(b'[]\nnonsense\n{"class":"TPV","mode":3}\n{"class":"TPV","mode":1}\n')
            assert _waited(source) == GeoFix(is_fixed=False)
        assert source.take() is None
        source.close()


def _waited(source: GpsdSource) -> GeoFix | None:
    """What comes over TCP, which may take a moment."""
    for _ in range(100_000):
        if (fix := source.take()) is not None:
            return fix
    return None


def test_positions_of_an_autopilot() -> None:
    common = pytest.importorskip("pymavlink.dialects.v20.common")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.bind(("127.0.0.1", 0))
        source = MavlinkSource("udpin:127.0.0.1:0")
        there = source._link._wire.port.getsockname()
        codec = common.MAVLink(None, srcSystem=1, srcComponent=1)

        def send(message: Any) -> None:
            out.sendto(message.pack(codec), there)

        raw = (0, 3, 20_000, 100_010_000, 90_000, 100, 100, 0, 0, 9)
        send(common.MAVLink_gps_raw_int_message(*raw))
        assert source.take() == GeoFix(True, 0.002, 10.001, 90.0)
        send(common.MAVLink_gps_raw_int_message(0, 1, *raw[2:]))
        assert source.take() == GeoFix(is_fixed=False)
        send(common.MAVLink_global_position_int_message(0, 30_000, 100_020_000, 91_000, *(0,) * 5))
        send(common.MAVLink_gps_raw_int_message(*raw))
        assert source.take() == GeoFix(True, 0.003, 10.002, 91.0)
        source.close()


def test_fixes_on_a_topic() -> None:
    pytest.importorskip("cyclonedds", reason="pip install 'koord[ros2]'")
    from koord.runtime.drivers.ros2 import messages as m
    from tests.runtime.platform.ros.test_heard import HeldGraph

    graph: Any = HeldGraph()
    source = TopicSource(graph, Wire("fix", "NavSatFix"))
    assert source.take() is None
    graph.ends["fix"].says.append(m.NavSatFix(latitude=1.0, longitude=2.0, altitude=3.0))
    assert source.take() == GeoFix(True, 1.0, 2.0, 3.0)
    graph.ends["fix"].says.append(m.NavSatFix(status=m.NavSatStatus(-1)))
    assert source.take() == GeoFix(is_fixed=False)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"connection": "udp:1"}, "is no connection of this source"),
        ({"connection": "serial:/dev/nowhere:9600"}, "nowhere|pyserial is needed"),
        ({"connection": "udpin:203.0.113.7:99"}, "cannot open"),
        ({"source": "gpsd", "connection": "udpin:1.2.3.4:1"}, "is no connection of this source"),
        ({"source": "gpsd", "connection": "tcp:127.0.0.1:9"}, "cannot open"),
        ({"source": "mavlink", "connection": "tcp:127.0.0.1:9"}, "is no connection"),
    ],
)
def test_a_source_that_cannot_be_opened_is_named(options: dict[str, str], told: str) -> None:
    with pytest.raises(DriverError, match=told) as caught:
        localiser(None, **options).open(0.0)
    assert caught.value.hint


@pytest.mark.parametrize("origin", [[91.0, 0.0, 0.0], [0.0, 181.0, 0.0], [0.0, 0.0]])
def test_an_origin_that_is_no_place_is_refused(origin: list[float]) -> None:
    with pytest.raises(msgspec.ValidationError):
        localiser(None, origin=origin)
