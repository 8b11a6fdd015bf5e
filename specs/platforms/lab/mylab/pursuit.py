"""A controller: it steers to a point of the way that lies a little ahead (pure pursuit)."""

import math

from msgspec import Struct

from koord.runtime.drivers.setpoints import Drive


class Options(Struct, frozen=True, forbid_unknown_fields=True):
    ahead: float = 0.3  #: m
    turn: float = 1.5  #: rad/s, at most


class Pursuit:
    OPTIONS = Options

    def __init__(self, site):
        self.options, self.speed = site.options, 0.0

    def step(self, vehicle):
        x, y, _ = vehicle.ahead(self.options.ahead)
        dx, dy = x - vehicle.position_m[0], y - vehicle.position_m[1]
        aside = math.remainder(math.atan2(dy, dx) - vehicle.heading_rad, math.tau)
        most = self.options.turn
        if abs(aside) > 0.6:  # it turns on the spot first
            self.speed = 0.0
            return Drive(0.0, max(-most, min(most, 2.0 * aside)))
        self.speed = min(self.speed + 0.5 * vehicle.dt_s, vehicle.limit_mps)
        speed = min(self.speed, max(0.05, vehicle.left_m))
        rate = 2.0 * speed * math.sin(aside) / max(math.hypot(dx, dy), 0.05)
        return Drive(speed, max(-most, min(most, rate)))
