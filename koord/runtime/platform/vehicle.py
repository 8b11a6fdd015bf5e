"""A driven vehicle: its driver, its pilot and its guardian, and the tick in which they act.

In each tick the driver is asked what it senses, the pilot says what it would do, and what the
guardian makes of that goes to the driver. (P-TICK)
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from koord.runtime.drivers.driver import Driver, DriverError
from koord.runtime.drivers.setpoints import Hold, Sensed, Wish
from koord.runtime.guardian.conditions import Setup
from koord.runtime.guardian.events import (
    Answer,
    Condition,
    Event,
    Note,
    Order,
    Ordered,
    Other,
    Ticked,
)
from koord.runtime.guardian.limits import SafetyLimits
from koord.runtime.guardian.machine import step
from koord.runtime.guardian.modes import Mode, initial
from koord.runtime.motion.world import Point, World
from koord.runtime.platform.pilots import Pilot
from koord.runtime.platform.sensors import MotionSensors
from koord.runtime.platform.watchdog import Watchdog, watchdog_of
from koord.runtime.protocol.events import Reason

#: So many notes are kept.
_MOST_NOTES = 256

#: A driver that takes longer blocks; on a busy machine some take longer than a tick now and then.
_BLOCKS_S = 0.25

#: For so long it is told that a driver blocked.
_REMARKED_S = 5.0

#: The modes in which a vehicle that stands stays where it is.
_ENDED = (Mode.DISARMED, Mode.STOPPED, Mode.ESTOPPED)


class DrivenVehicle:
    """The vehicle of one robot. ``notes`` are the guardian's last ones."""

    def __init__(
        self, driver: Driver, pilot: Pilot, setup: Setup, now_s: float, *, watched: bool = False
    ) -> None:
        """Connect to the vehicle, and wait until it is known where it is. Raises DriverError.

        ``watched``: it is to move, and so something has to stop it if this process is killed.
        (P-WATCHDOG)
        """
        self.driver, self.pilot = driver, pilot
        self.notes: deque[Note] = deque(maxlen=_MOST_NOTES)
        self._is_heard = True  #: the driver has taken the last set-point
        self._blocked = "", -math.inf  #: how the driver blocked, and when that was over
        self.is_ending = False  #: it is coming to its last stop
        self.now_s = now_s  #: of the last tick
        self._matters: dict[Condition, str] = {}
        self._setup = setup
        self._guardian = initial(now_s)
        begun_s = time.monotonic()
        driver.open(now_s)
        # Clocks of vehicles are compared with ours: what is read now was not sent before.
        sensed = driver.sense(now_s + time.monotonic() - begun_s)
        if sensed is None:
            raise DriverError("the vehicle does not say where it is", "is it switched on?")
        self.sensed: Sensed = sensed
        self._prepare_takeoff(driver.capabilities.takeoff_height_m)
        self._watchdog = self._watched() if watched else None

    @property
    def mode(self) -> Mode:
        """The guardian's mode."""
        return self._guardian.mode

    @property
    def conditions(self) -> frozenset[Condition]:
        """Why it may not move."""
        return self._guardian.conditions

    @property
    def stands(self) -> bool:
        """True if it was on the ground and still at the last tick."""
        return self._guardian.at_rest

    def matter(self, condition: Condition) -> str | None:
        """What people are told of a condition that is there."""
        return self._matters.get(condition) if condition in self._guardian.conditions else None

    @property
    def limits(self) -> SafetyLimits:
        return self._setup.limits

    @property
    def world(self) -> World:
        """The world that it may not leave."""
        return self._setup.field.world

    @property
    def dead_man(self) -> str | None:
        """What stops it if this process is killed; None: nothing."""
        if self._watchdog is not None:
            return f"a watchdog, after {self.limits.watchdog_s:g} s"
        own_s = self.driver.capabilities.dead_man_s
        return None if own_s is None else f"it stops by itself, after {own_s:g} s"

    @property
    def is_at_rest(self) -> bool:
        """True if it is on the ground and does not move any more."""
        return self.mode in _ENDED and self._guardian.at_rest and self._is_heard

    @property
    def remarks(self) -> tuple[str, ...]:
        """Why the vehicle does not do what its program wants, if so."""
        said, at_s = self._blocked
        blocked = (said,) if time.monotonic() - at_s < _REMARKED_S else ()
        own = (*blocked, *self.pilot.remarks, *self.driver.remarks)
        if self.mode is Mode.RUNNING or self.mode in _ENDED:
            return own
        return (*self._matters.values(), *own)

    @property
    def sensors(self) -> MotionSensors:
        """What the robot's program reads."""
        return self.pilot.sensors(self.sensed)

    def follow(self, path: Sequence[Point]) -> None:
        """Follow a path; an empty one leaves the robot where it is."""
        self.pilot.follow(path, self.sensed)

    def go_to(self, target: Point) -> None:
        """Find a path to a target and follow it."""
        self.pilot.go_to(target)

    def order(self, order: Order, now_s: float) -> tuple[Note, ...]:
        """Do what people say; return what the guardian says to that."""
        return self._step(Ordered(now_s, order), now_s)

    def tick(
        self,
        now_s: float,
        round_age_s: float | None,
        holding: Reason | None = None,
        others: tuple[Other, ...] = (),
        heartbeat_age_s: float | None = None,
    ) -> None:
        """Sense, and command the vehicle. ``round_age_s``: since the last commit, if any.

        ``heartbeat_age_s``: since people were there, with the e-stop; None: never.
        """
        self.now_s = now_s
        watchdog = None if self._watchdog is None else self._watchdog.feed()
        sensed = self._sensed(now_s)
        wish: Wish | None = None
        if sensed is not None:
            self.sensed = sensed
            wish = self._wish(now_s)
        tick = Ticked(now_s, sensed, wish, round_age_s, holding, others, heartbeat_age_s, watchdog)
        self._step(tick, now_s)

    def _watched(self) -> Watchdog | None:
        try:
            return watchdog_of(self.driver.capabilities, self._setup.limits)
        except DriverError:
            self.driver.close()
            raise

    def _prepare_takeoff(self, height_m: float | None) -> None:
        world, limits = self._setup.field.world, self._setup.limits
        if height_m is not None and world.ground + height_m > world.high[2] - limits.margin_m:
            self.driver.close()
            raise DriverError(
                f"a take-off to {height_m:g} m leads out of the fence, whose top is at"
                f" {world.high[2]:g} m (margin {limits.margin_m:g} m)",
                "make the take-off lower, or the world higher",
            )
        self.pilot.takeoff_height_m = height_m

    @contextmanager
    def _timed(self, what: str) -> Iterator[None]:
        """Notice a driver that blocks: nothing else is done meanwhile. (P-DRIVER)"""
        begun_s = time.monotonic()
        yield
        took_s = time.monotonic() - begun_s
        if took_s > _BLOCKS_S:
            said = f"the driver took {took_s:.2f} s to {what}: it is not to block"
            self._blocked = said, begun_s + took_s

    def _sensed(self, now_s: float) -> Sensed | None:
        """What the driver senses; at the end one that raises senses nothing. (P-LAST-STOP)"""
        try:
            with self._timed("sense"):
                return self.driver.sense(now_s)
        except Exception:  # whatever a driver does: it may still hear
            if not self.is_ending:
                raise
            return None

    def _wish(self, now_s: float) -> Wish:
        is_running = self.mode is Mode.RUNNING
        (self.pilot.release if is_running else self.pilot.hold)()
        wish = self.pilot.wish(self.sensed, now_s)
        return wish if is_running and not self.pilot.troubles else Hold()

    def _step(self, event: Event, now_s: float) -> tuple[Note, ...]:
        answer: Answer
        self._guardian, answer = step(self._setup, self._guardian, event)
        self.notes += answer.notes
        for note in answer.notes:
            if note.condition is None:
                continue
            if note.condition in self._guardian.conditions:
                self._matters[note.condition] = note.text
            else:
                self._matters.pop(note.condition, None)
        if answer.setpoint is not None:
            self._is_heard = False
            with self._timed("command the vehicle"):
                self.driver.command(answer.setpoint, now_s)
            self._is_heard = True
        return answer.notes

    def close(self) -> None:
        """Let go of the vehicle."""
        try:
            self.driver.close()
        finally:
            if self._watchdog is not None:
                self._watchdog.close()
