"""Disturbances of simulated robots: noise, slow positioning, delay and wind, all seeded.

Each robot has a generator of its own, spawned from one seed, so what happens to a robot does not
depend on how many others there are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from koord.runtime.motion.arrays import Floats

#: Random numbers are drawn for so many steps at a time.
_BLOCK = 64


class Positioning(Struct, frozen=True):
    """The quality of positioning: standard deviations and the rate of fixes.

    The defaults are those of motion capture: exact, and new at every step of control.
    """

    noise_m: float = 0.0
    heading_noise_rad: float = 0.0
    rate_hz: float | None = None  #: None: whenever a controller asks


class Wind(Struct, frozen=True):
    """Wind on drones: a mean and gusts (an Ornstein–Uhlenbeck process), in m/s.

    Gusts have the standard deviation ``gust_mps`` along each axis and die down with ``calm_s``.
    """

    mean_mps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gust_mps: float = 0.0
    calm_s: float = 1.5


class Disturbances(Struct, frozen=True):
    """All disturbances of a kind of robot, as in the configuration."""

    positioning: Positioning = Positioning()
    actuation_delay_s: float = 0.0
    wind: Wind = Wind()


def spawned(seed: np.random.SeedSequence, number: int) -> np.random.SeedSequence:
    """The seed that is the ``number``-th of those that a seed spawns first, without the others."""
    return np.random.SeedSequence(
        seed.entropy, spawn_key=(*seed.spawn_key, number), pool_size=seed.pool_size
    )


class Normals:
    """Generators of standard normal numbers for ``len(seeds)`` robots, ``width`` per step."""

    def __init__(self, seeds: Sequence[np.random.SeedSequence], width: int) -> None:
        self._block: Floats = np.empty((len(seeds), _BLOCK, width))
        self.reseed(seeds)

    def reseed(self, seeds: Sequence[np.random.SeedSequence]) -> None:
        """Draw by other seeds from now on. What was drawn ahead by the last ones is forgotten."""
        self._sources = [np.random.default_rng(seed) for seed in seeds]
        self._next = _BLOCK

    def draw(self) -> Floats:
        """Draw the next numbers, shape ``(n, width)``."""
        if self._next == _BLOCK:
            for source, block in zip(self._sources, self._block, strict=True):
                source.standard_normal(out=block)
            self._next = 0
        drawn: Floats = self._block[:, self._next].copy()
        self._next += 1
        return drawn


class Gusts:
    """The gusts of wind at ``n`` robots."""

    def __init__(self, wind: Wind, seeds: Sequence[np.random.SeedSequence]) -> None:
        self.wind = wind
        self._mean = np.array(wind.mean_mps)
        self._gust: Floats = np.zeros((len(seeds), 3))
        self._normals = Normals(seeds, 3) if wind.gust_mps > 0 else None

    def reseed(self, seeds: Sequence[np.random.SeedSequence]) -> None:
        """Let gusts to come hang on other seeds; those that blow go on."""
        if self._normals is not None:
            self._normals.reseed(seeds)

    def blow(self, dt_s: float) -> Floats:
        """The wind in m/s for the next step, shape ``(n, 3)``."""
        if self._normals is not None:
            fade = math.exp(-dt_s / self.wind.calm_s)
            fresh = self.wind.gust_mps * math.sqrt(1 - fade * fade)
            self._gust = fade * self._gust + fresh * self._normals.draw()
        return self._mean + self._gust


class Fixes:
    """The fixes of robots: measured positions and headings."""

    def __init__(
        self,
        positioning: Positioning,
        seeds: Sequence[np.random.SeedSequence],
        flat: bool,
    ) -> None:
        noisy = positioning.noise_m > 0 or positioning.heading_noise_rad > 0
        self._normals = Normals(seeds, 4) if noisy else None
        self._spread = np.array([*[positioning.noise_m] * 2, 0.0 if flat else positioning.noise_m])
        self._turn = positioning.heading_noise_rad
        self._period = 1.0 / positioning.rate_hz if positioning.rate_hz else 0.0
        self._due_s = 0.0
        self._last: tuple[Floats, Floats] | None = None

    def reseed(self, seeds: Sequence[np.random.SeedSequence]) -> None:
        """Let fixes to come hang on other seeds; the last ones stay."""
        if self._normals is not None:
            self._normals.reseed(seeds)

    def read(self, position: Floats, heading_rad: Floats, now_s: float) -> tuple[Floats, Floats]:
        """The fixes at a time: new ones if due, else the last ones again."""
        if self._last is not None and now_s < self._due_s - 1e-9:
            return self._last
        while self._period and self._due_s <= now_s + 1e-9:
            self._due_s += self._period
        if self._normals is not None:
            drawn = self._normals.draw()
            position = position + self._spread * drawn[:, :3]
            heading_rad = heading_rad + self._turn * drawn[:, 3]
        self._last = position.copy(), heading_rad.copy()
        return self._last


class Delay:
    """A delay line, in which commands wait for ``steps`` steps of control."""

    def __init__(self, steps: int, at_first: Floats) -> None:
        self._line = [at_first.copy() for _ in range(steps)]

    def pass_on(self, command: Floats) -> Floats:
        """Put a command in, and return the one that is due."""
        if not self._line:
            return command
        self._line.append(command.copy())
        return self._line.pop(0)
