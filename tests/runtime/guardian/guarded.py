"""A guarded robot in a world, of which every step is checked."""

from __future__ import annotations

from msgspec.structs import replace

from koord.runtime.drivers.setpoints import Hold, Sensed, Wish
from koord.runtime.guardian.conditions import Setup, judged
from koord.runtime.guardian.events import Answer, Condition, Order, Ordered, Ticked
from koord.runtime.guardian.invariants import Transition, broken
from koord.runtime.guardian.limits import EstopAction, SafetyLimits
from koord.runtime.guardian.machine import step
from koord.runtime.guardian.modes import Mode, State, initial
from koord.runtime.motion.field import field
from koord.runtime.motion.world import Box, World

#: 10 × 10 × 3 m about the origin, with a block of 1 m at (3, 0).
WORLD = World((-5.0, -5.0, 0.0), (5.0, 5.0, 3.0), (Box((2.5, -0.5, 0.0), (3.5, 0.5, 3.0)),))

CAR = SafetyLimits(hold_s=10.0, resume_s=1.0, separation_m=0.5)
DRONE = replace(CAR, flies=True, estop=EstopAction.LAND)

LEVEL = (1.0, 0.0, 0.0, 0.0)

DELTA_S = 0.1


def setup_of(limits: SafetyLimits, world: World = WORLD) -> Setup:
    return Setup(limits, field(world, flat=not limits.flies), DELTA_S)


def standing(now_s: float = 0.0) -> Sensed:
    return Sensed((0.0, 0.0, 0.0), LEVEL, (0.0, 0.0, 0.0), now_s)


class Guarded:
    """A guardian that is told at each tick that all is well, but for what a test says."""

    def __init__(self, limits: SafetyLimits = CAR) -> None:
        self.setup = setup_of(limits)
        self.state: State = initial(0.0)
        self.now_s = 0.0
        self.answer = Answer(None)

    def mode(self) -> Mode:
        return self.state.mode

    @property
    def conditions(self) -> set[Condition]:
        return set(self.state.conditions)

    def well(self, **sensed: object) -> Ticked:
        """A tick at which all is well, with what else is sensed."""
        now = replace(standing(self.now_s), **sensed)
        return Ticked(self.now_s, now, Hold(), round_age_s=0.05)

    def tick(self, tick: Ticked | None = None, wish: Wish | None = None) -> Answer:
        """One step at a tick."""
        tick = tick if tick is not None else self.well()
        if wish is not None:
            tick = replace(tick, wish=wish)
        facts = judged(self.setup, self.state, tick).facts
        after, self.answer = step(self.setup, self.state, tick)
        setpoint = self.answer.setpoint
        self._check(after, setpoint=setpoint, facts=facts, wish=tick.wish)
        return self.answer

    def order(self, order: Order) -> Answer:
        """One step after an order."""
        after, self.answer = step(self.setup, self.state, Ordered(self.now_s, order))
        self._check(after, setpoint=self.answer.setpoint, order=order)
        return self.answer

    def _check(self, after: State, **told: object) -> None:
        transition = Transition(self.setup.limits, self.state, after, **told)  # type: ignore[arg-type]
        assert list(broken(transition)) == []
        self.state = after

    def wait(self, seconds: float, step_s: float = 0.05) -> Guarded:
        """Let time pass in which all is well."""
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            self.now_s += step_s
            self.tick()
        return self

    def running(self) -> Guarded:
        """Arm and start, when all has been well for long enough."""
        self.wait(self.setup.limits.resume_s + 0.1)
        self.order(Order.ARM)
        self.order(Order.START)
        assert self.mode() is Mode.RUNNING
        return self

    def texts(self) -> str:
        return "\n".join(note.text for note in self.answer.notes)
