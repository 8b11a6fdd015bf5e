"""One step of the machine while it is being taken: the state so far, and what is wanted done."""

from __future__ import annotations

from typing import Any

from msgspec.structs import replace

from koord.runtime.protocol.events import (
    Arm,
    Disarm,
    Effect,
    Hold,
    Reason,
    Resume,
    Send,
    Tell,
    Timer,
)
from koord.runtime.protocol.messages import Message
from koord.runtime.protocol.setup import Setup
from koord.runtime.protocol.state import Follower, Office, State

#: Waits for answers are doubled so many times at most.
MOST_DOUBLINGS = 2


class StepContext:
    """Lives as long as one call of ``step``; nobody else sees it."""

    __slots__ = ("effects", "now", "setup", "state")

    def __init__(self, setup: Setup, state: State, now: float) -> None:
        self.setup = setup
        self.state = state
        self.now = now
        self.effects: list[Effect] = []

    def change(self, **fields: Any) -> None:
        """Give fields of the state new values."""
        self.state = replace(self.state, **fields)

    def take(self, office: Office) -> None:
        self.state = replace(self.state, office=office)

    # --- effects --------------------------------------------------------------------------------

    def want(self, effect: Effect) -> None:
        self.effects.append(effect)

    def send(self, to: int, message: Message) -> None:
        if to != self.state.pid:
            self.effects.append(Send(to, message))

    def tell(self, message: Message) -> None:
        if self.setup.robots > 1:
            self.effects.append(Tell(message))

    def arm(self, timer: Timer, after_s: float) -> None:
        self.effects.append(Arm(timer, after_s))

    def disarm(self, timer: Timer) -> None:
        self.effects.append(Disarm(timer))

    def hold(self, reason: Reason) -> None:
        if self.state.holding is not reason:
            self.change(holding=reason)
            self.effects.append(Hold(reason))

    def resume(self) -> None:
        if self.state.holding is not None:
            self.change(holding=None)
            self.effects.append(Resume())

    # --- waiting --------------------------------------------------------------------------------

    def await_answer(self, extra_s: float = 0.0) -> None:
        """Start waiting for an answer to something new. (R-AGAIN)"""
        self.change(tries=0)
        self.arm(Timer.RESEND, extra_s + self.setup.timing.resend_s)

    def await_longer(self) -> None:
        """Go on waiting, for twice as long as before."""
        tries = min(self.state.tries + 1, MOST_DOUBLINGS)
        self.change(tries=tries)
        self.arm(Timer.RESEND, self.setup.timing.resend_s * 2**tries)

    def watch_leader(self) -> None:
        """The coordinator was heard: start anew to wait for silence. (R-SILENCE)"""
        self.arm(Timer.SILENCE, self.setup.timing.silence_s)

    def hear(self, epoch: int) -> None:
        """Remember that an epoch exists, so that elections start above it."""
        if epoch > self.state.seen:
            self.change(seen=epoch)

    def promise(self, epoch: int) -> None:
        """Accept from no epoch below this one any more. Whoever held a lower one steps down."""
        self.hear(epoch)
        if epoch > self.state.promised:
            self.change(promised=epoch)

    def follow_nobody(self) -> None:
        """Step down, and wait for someone to stand; for how long depends on the pid. (R-SILENCE)"""
        state, setup = self.state, self.setup
        self.take(Follower(None))
        self.disarm(Timer.DEADLINE)
        slots = setup.distance(state.pid, state.seen)
        self.arm(Timer.SILENCE, setup.timing.slot_s * slots)
