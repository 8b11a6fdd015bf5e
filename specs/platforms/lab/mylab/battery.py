"""A module: a battery, which the lab's electronics tell of; simulated, it drains on the way."""

import math

from msgspec import Struct

from koord.runtime.plugins.modules import OwnModule


class Options(Struct, frozen=True, forbid_unknown_fields=True):
    file: str = "/sys/class/power_supply/BAT0/capacity"  #: per cent
    per_metre: float = 0.02  #: of 1, simulated


class Battery(OwnModule):
    OPTIONS, SENSORS, ACTUATORS = Options, ("charge",), ()

    def __init__(self, site):
        self.site, self.charge, self.last = site, 1.0, None

    def read(self, sensed, now_s):
        if self.site.is_simulated:
            if self.last is not None:
                far = math.dist(self.last, sensed.position_m)
                self.charge = max(0.0, self.charge - self.site.options.per_metre * far)
            self.last = sensed.position_m
        else:
            with open(self.site.options.file) as file:
                self.charge = min(self.charge, int(file.read()) / 100)
        return {"charge": self.charge}
