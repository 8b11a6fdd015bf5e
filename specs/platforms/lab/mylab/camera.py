"""A module: a camera that sees tags; simulated, those that are near, in front of it."""

import math
from pathlib import Path

from msgspec import Struct

from koord.runtime.drivers.frames import yaw_of
from koord.runtime.plugins.modules import OwnModule


class Options(Struct, frozen=True, forbid_unknown_fields=True):
    tags: dict[int, tuple[float, float]] = {}  #: where they are, simulated
    range: float = 1.0  #: m
    file: str = "/run/tag"  #: where what looks at pictures writes the number of the tag, or -1


class Camera(OwnModule):
    OPTIONS, SENSORS, ACTUATORS = Options, ("tag",), ()

    def __init__(self, site):
        self.site = site

    def read(self, sensed, now_s):
        """The number of the nearest tag that it sees; -1: none."""
        if not self.site.is_simulated:
            return {"tag": int(Path(self.site.options.file).read_text())}
        (x, y, _), heading = sensed.position_m, yaw_of(sensed.attitude)
        seen = [
            (far, number)
            for number, (tx, ty) in self.site.options.tags.items()
            for far in [math.hypot(tx - x, ty - y)]
            if far <= self.site.options.range
            and (
                far < 0.3
                or abs(math.remainder(math.atan2(ty - y, tx - x) - heading, math.tau)) < 0.8
            )
        ]
        return {"tag": min(seen)[1] if seen else -1}
