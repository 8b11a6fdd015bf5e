"""The driver of the lab's car, which speaks lines of text over UDP (see firmware.py)."""

import math
import socket
import time
from contextlib import suppress

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.drivers.driver import Driver, DriverError
from koord.runtime.drivers.frames import turned
from koord.runtime.drivers.setpoints import Capabilities, Drive, Sensed


class Options(Struct, frozen=True, forbid_unknown_fields=True):
    host: str = "127.0.0.1"
    port: int = 7000  #: of the car with pid 0; the next ones follow


class Car(Driver):
    OPTIONS = Options
    remarks = ()

    def __init__(self, device):
        self.address = device.options.host, device.options.port + device.pid
        self.capabilities = Capabilities(("DIFF",), (Drive,), 20.0, 0.1, dead_man_s=0.5)
        self.wire, self.sensed = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), None
        self.wire.setblocking(False)

    def open(self, now_s):
        end_s = time.monotonic() + 3.0
        while self.sense(time.monotonic()) is None:
            if time.monotonic() > end_s:
                raise DriverError(f"no car answers at {self.address}", "is it switched on?")
            time.sleep(0.02)

    def sense(self, now_s):
        with suppress(OSError):  # nothing more has arrived, or nobody is there
            self.wire.sendto(b"where", self.address)
            while line := self.wire.recv(200):
                x, y, heading, speed = map(float, line.split())
                velocity = speed * math.cos(heading), speed * math.sin(heading), 0.0
                self.sensed = Sensed((x, y, 0.0), turned(heading), velocity, now_s)
        link = self.sensed is not None and now_s - self.sensed.measured_at_s < 1.0
        self.remarks = () if link else (f"the car at {self.address} is silent",)
        return self.sensed and replace(self.sensed, link=link)

    def command(self, setpoint, now_s):
        drives = setpoint if isinstance(setpoint, Drive) else Drive(0.0)
        with suppress(OSError):
            told = f"drive {drives.speed_mps:.4f} {drives.yaw_rate_radps:.4f}"
            self.wire.sendto(told.encode(), self.address)

    def close(self):
        self.wire.close()
