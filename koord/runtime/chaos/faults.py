"""How bad a network is, and how often robots die."""

from __future__ import annotations

from msgspec import Struct


class Faults(Struct, frozen=True):
    """Probabilities are per message, or per robot and second; durations are seconds."""

    loss: float = 0.0
    duplication: float = 0.0
    least_delay_s: float = 0.001
    most_delay_s: float = 0.002
    crashes_per_s: float = 0.0
    least_outage_s: float = 0.1
    most_outage_s: float = 1.0
    for_ever: float = 0.0  #: the part of the crashes after which a robot does not come back
    cuts_per_s: float = 0.0  #: how often the network falls into two parts
    cut_s: float = 0.5
    coordinator_dies_every_s: float = 0.0


CALM = Faults()

#: Radio in a bad place.
LOSS = Faults(loss=0.3, duplication=0.05, most_delay_s=0.05)

#: All of it at once.
CHAOS = Faults(
    loss=0.2,
    duplication=0.1,
    most_delay_s=0.15,
    crashes_per_s=0.15,
    cuts_per_s=0.2,
    cut_s=0.7,
)
