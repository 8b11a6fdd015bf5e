"""A module: a gripper at a serial port; simulated, it takes half a second."""

from pathlib import Path

from msgspec import Struct

from koord.runtime.plugins.modules import OwnModule


class Options(Struct, frozen=True, forbid_unknown_fields=True):
    port: str = "/dev/ttyUSB0"
    takes: float = 0.5  #: s


class Gripper(OwnModule):
    OPTIONS, SENSORS, ACTUATORS = Options, ("holds",), ("close",)

    def __init__(self, site):
        self.site, self.closed_at_s = site, None

    def read(self, sensed, now_s):
        closed = self.closed_at_s is not None
        return {"holds": closed and now_s - self.closed_at_s >= self.site.options.takes}

    def act(self, port, value, now_s):
        self.closed_at_s = now_s if value else None
        if not self.site.is_simulated:
            Path(self.site.options.port).write_bytes(b"close\n" if value else b"open\n")
