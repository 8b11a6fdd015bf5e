"""Seeded mistakes in what people say to robots, and in what they look at before."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

HEARING = "tests/runtime/orders/test_hearing.py"
CALLING = "tests/runtime/orders/test_calling.py"
OBEYING = "tests/runtime/orders/test_obeying.py"
PREFLIGHT = "tests/runtime/platform/test_preflight.py"
PLACES = "tests/runtime/orders/test_places.py"

#: What stops a fleet, and does not, or lets one move that should not.
ORDERED = (
    Mutant(
        "forged orders are obeyed",
        "runtime.wire.frames.Proving._opened",
        "not compare_digest(proof.digest(), datagram[end:])",
        "False",
        (HEARING,),
    ),
    Mutant(
        "recorded starts are obeyed for ever",
        "runtime.orders.hearing.Hearer._stamped_at_s",
        "0 <= now_s - stamp.at_s <= FRESH_S",
        "True",
        (HEARING,),
    ),
    Mutant(
        "stamps of another process of the robot count",
        "runtime.orders.hearing.Hearer._stamped_at_s",
        "stamp is None or stamp.boot != self._boot",
        "stamp is None",
        (HEARING,),
    ),
    Mutant(
        "recorded e-stops are obeyed for ever",
        "runtime.orders.hearing.Hearer._counts",
        "abs(self._wall() - request.said_at_s) <= SAID_S",
        "True",
        (HEARING,),
    ),
    Mutant(
        "robots whose clock is off cannot be stopped",
        "runtime.orders.hearing.Hearer._counts",
        "at_s is not None or abs(self._wall() - request.said_at_s) <= SAID_S",
        "abs(self._wall() - request.said_at_s) <= SAID_S",
        (HEARING, CALLING),
    ),
    Mutant(
        "a start that was on its way for long undoes the stop after it",
        "runtime.orders.hearing.Hearer._counts",
        "at_s is not None and at_s > self._stopped_at_s",
        "at_s is not None",
        (HEARING,),
    ),
    Mutant(
        "copies of orders are obeyed again",
        "runtime.orders.hearing.Hearer._obeyed",
        "self._known[request.id] = made",
        "self._known[b''] = made",
        (HEARING, CALLING),
    ),
    Mutant(
        "robots obey what is said to others",
        "runtime.orders.hearing.Hearer.hear",
        "request.robot != self._pid",
        "False",
        (HEARING,),
    ),
    Mutant(
        "a heartbeat is as young as its arrival",
        "runtime.orders.hearing.Hearer._outcome",
        "self.alive_at_s = max(at_s, self.alive_at_s or at_s)",
        "self.alive_at_s = now_s",
        (HEARING,),
    ),
    Mutant(
        "guardians are not told of heartbeats",
        "runtime.platform.host.VehiclePlatform.alive",
        "self._alive_at_s = at_s",
        "self._beacon_due_s = at_s",
        (OBEYING,),
    ),
    Mutant(
        "robots without a heartbeat move",
        "runtime.platform.vehicle.DrivenVehicle.tick",
        "Ticked(now_s, sensed, wish, round_age_s, holding, others, heartbeat_age_s, watchdog)",
        "Ticked(now_s, sensed, wish, round_age_s, holding, others, 0.0, watchdog)",
        (OBEYING,),
    ),
    Mutant(
        "after a reset robots move by themselves",
        "runtime.platform.host.VehiclePlatform.order",
        "self._goes = False",
        "self._goes = True",
        (OBEYING,),
    ),
    Mutant(
        "robots hear orders in a run only",
        "runtime.deploy.running.Runner._heed",
        "self._transport.visits()",
        "self._transport.visits() if self.peer is not None else ()",
        (OBEYING,),
    ),
    Mutant(
        "who has not answered is said to have stopped",
        "runtime.orders.calling.Called.has_done_it",
        "self.reply is not None and self.reply.outcome in (Outcome.DONE, Outcome.HEARD)",
        "True",
        (CALLING,),
    ),
    Mutant(
        "what is bad is armed if people say yes",
        "api.preflight.Looking.hear",
        "answer and self.found.is_good",
        "answer",
        (PREFLIGHT,),
    ),
    Mutant(
        "robots begin a run while people still look at another one",
        "runtime.deploy.running.Runner.step",
        "self._waits",
        "self._waits and self._pid == 0",
        (PREFLIGHT,),
    ),
    Mutant(
        "a vehicle may be anywhere when it is armed",
        "runtime.platform.checks._position",
        "off_m <= most_m",
        "True",
        (PREFLIGHT,),
    ),
    Mutant(
        "everybody can read the keys of what runs here",
        "runtime.orders.places.found",
        "not _is_ours(place)",
        "False",
        (PLACES,),
    ),
)
