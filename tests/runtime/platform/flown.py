"""A Crazyflie's driver and a simulated Crazyflie in one process, in virtual time.

cflib stands between: what it sends and what it makes of answers is real; only its threads are left
out, so that each test runs alike.
"""

from __future__ import annotations

import random
from typing import Any

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.crazyflie.driver import CrazyflieDriver
from koord.runtime.drivers.crazyflie.library import Crazyflie, CRTPPacket
from koord.runtime.drivers.crazyflie.link import Command, Down, Ear, Heard
from koord.runtime.drivers.crazyflie.options import CrazyflieOptions
from koord.runtime.drivers.driver import Device
from koord.testing.crazyflie.machine import Packet, Settings, SimulatedCrazyflie, State
from koord.testing.crazyflie.serving import datagram_of, packet_of
from tests.runtime.platform.bench import WORLD, AircraftBench


class Air:
    """A link in virtual time, on which packets are lost as is said."""

    needs_resending = False  #: of cflib's link drivers, of which this is one

    def __init__(self, settings: Settings, seed: int = 0) -> None:
        self.now = 100.0
        self.crazyflie = SimulatedCrazyflie(settings, self.now)
        self.loss = 0.0  #: of packets that the driver sends
        self.up = self.down = True
        self.sent: list[Packet] = []
        self.connects = 0
        self._random = random.Random(seed)
        self._arrived: list[Packet] = []
        self._client: Any = None
        self._ear: Ear | None = None
        self._lost: list[Heard] = []

    def connected(self, options: CrazyflieOptions) -> Air:
        """Make cflib's side of it."""
        self._client = client = Crazyflie()
        client.param.request_update_of_all_params = lambda: None
        client.link_statistics.latency.start = lambda: None
        self._ear = Ear(client, options, lambda: self.now)
        return self

    # --- the link of the driver -----------------------------------------------------------------

    def open(self) -> None:
        self.connects += 1
        self._client.link = self
        self._client._start_connection_setup()
        self._pass_on()

    def receive(self) -> list[Heard]:
        self._pass_on()
        assert self._ear is not None
        lost, self._lost = self._lost, []
        return lost + self._ear.heard()

    def send(self, command: Command, lasts_s: float) -> None:
        command(self._client)

    def connect_again(self) -> None:
        if self.up and self.down:
            self.open()
        else:
            self._lost.append(Down("Too many packets lost"))

    def wait(self, most_s: float) -> float:
        self.pass_time(self.now + most_s)
        return most_s

    def close(self) -> None:
        self.up = self.down = False

    # --- the link of cflib ----------------------------------------------------------------------

    def send_packet(self, packet: Any) -> None:
        sent = packet_of(bytes([packet.header, *packet.data]))
        self.sent.append(sent)
        if self.up and self._random.random() >= self.loss:
            self.crazyflie.hear(sent)

    # --- time -----------------------------------------------------------------------------------

    def pass_time(self, until_s: float) -> None:
        while self.now < until_s - 1e-9:
            self.now = min(until_s, self.now + 0.01)
            self.crazyflie.advance(self.now)
            self._pass_on()

    def _pass_on(self) -> None:
        """Pass on what it tells, and what it answers to what is said then."""
        while told := list(self.crazyflie.tell()):
            for packet in told if self.down else ():
                data = datagram_of(packet)
                heard = CRTPPacket(data[0], list(data[1:]))
                for one in list(self._client.incoming.cb):
                    on_port = one.port == heard.port & one.port_mask
                    if on_port and one.channel == heard.channel & one.channel_mask:
                        one.callback(heard)


class Bench(AircraftBench[Air, CrazyflieDriver]):
    """A driver and its Crazyflie."""

    def __init__(self, air: Air | None = None, vehicle: Vehicle | None = None, **options: Any):
        air = air or Air(Settings())
        told = CrazyflieOptions(uri="udp://127.0.0.1:19850", **options)
        described = vehicle or Vehicle("drone", "QUAD")
        device = Device(0, described, WORLD, (1.0, 2.0, 0.0), options=told)
        super().__init__(air, CrazyflieDriver(device, air.connected(told)))

    @property
    def crazyflie(self) -> SimulatedCrazyflie:
        return self.air.crazyflie

    def state(self) -> State:
        """That of its supervisor."""
        return self.crazyflie.state

    def remarks(self) -> tuple[str, ...]:
        return self.driver.remarks

    def sent(self, port: int, channel: int = 0) -> list[bytes]:
        """What it was sent on a port."""
        return [data for at, on, data in self.air.sent if (at, on) == (port, channel)]
