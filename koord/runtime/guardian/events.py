"""What the guardian is told, and what it answers."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct

from koord.runtime.drivers.setpoints import Sensed, Setpoint, Wish
from koord.runtime.motion.world import Point
from koord.runtime.protocol.events import Reason


class Order(Enum):
    """What people say."""

    ARM = "arm"
    START = "start"  #: move; after STOP, and after having been outside of the fence: go on
    STOP = "stop"  #: hold until START
    LAND = "land"  #: end: an aircraft lands, what drives stops for good. SIGTERM and Ctrl-C
    ESTOP = "e-stop"
    RESET = "reset"  #: after an e-stop, or at the end


class Condition(Enum):
    """The reasons why a robot may not move, by their rules."""

    ROUND = "no committed round"  #: (G-ROUND)
    PROTOCOL = "the protocol holds"  #: (G-PROTOCOL)
    LINK = "no link to the vehicle"  #: (G-LINK)
    HEARTBEAT = "no heartbeat of the e-stop"  #: (G-HEARTBEAT)
    WATCHDOG = "no watchdog"  #: (G-WATCHDOG)
    BATTERY = "battery low"  #: (G-BATTERY)
    POSE = "no pose"  #: (G-POSE)
    JUMP = "the pose jumped"  #: (G-JUMP)
    FENCE = "outside of the fence"  #: (G-FENCE)
    AHEAD = "on its way out of the fence"  #: (G-AHEAD)
    WISH = "a wish that is not safe"  #: (G-WISH)
    APART = "too close to another robot"  #: (G-APART)


# --- events -------------------------------------------------------------------------------------


class Ordered(Struct, frozen=True):
    """Event: a person, or a signal, has given an order. ``now_s`` is monotonic."""

    now_s: float
    order: Order


class Other(Struct, frozen=True):
    """Another robot: where it was last known to be, and how it moved there."""

    pid: int
    position_m: Point
    velocity_mps: Point
    age_s: float


class Ticked(Struct, frozen=True):
    """Event: time has passed, and this is what is known now."""

    now_s: float
    sensed: Sensed | None  #: None: the driver has told nothing yet
    wish: Wish | None  #: what motion would do; None: nothing
    round_age_s: float | None  #: since a round was committed; None: none was
    holding: Reason | None = None  #: why the protocol holds
    others: tuple[Other, ...] = ()
    heartbeat_age_s: float | None = None  #: of the e-stop
    watchdog: str | None = None  #: why that cannot be relied on, if so


Event = Ordered | Ticked


# --- answers ------------------------------------------------------------------------------------


class Note(Struct, frozen=True):
    """Something to tell people, once. ``condition``: the one that begins or ends."""

    now_s: float
    text: str
    condition: Condition | None = None


class Answer(Struct, frozen=True):
    """What goes to the driver now, and to people. A tick always has a set-point. (G-TICK)"""

    setpoint: Setpoint | None
    notes: tuple[Note, ...] = ()
