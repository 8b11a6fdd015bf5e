"""What a vehicle is in contact with, as the engine that moves it has it."""

from __future__ import annotations

from typing import NamedTuple

from koord.runtime.motion.planning import Hindrance


class Touched(NamedTuple):
    """Something that a vehicle touches: another vehicle, an obstacle, or the edge of the world."""

    what: Hindrance
    number: int = 0  #: of the obstacle, or of the vehicle among those that are ``others``
    others: object = None
