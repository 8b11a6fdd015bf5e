"""Why a datagram was dropped."""

from __future__ import annotations

from collections import Counter
from enum import Enum


class Drop(Enum):
    """Every datagram that is not a message for this robot is one of these."""

    SIZE = "too short or too long"
    NOT_KOORD = "of another protocol"
    VERSION = "of another version"
    STRANGER = "from no robot of this run"
    FORGED = "not authentic: another key, another run, or damaged"
    REPLAYED = "seen before, or from before a restart"
    OLD = "of a round long past"
    FRAGMENT = "an impossible piece of a message"
    UNFINISHED = "a piece of a message that never got complete"
    MALFORMED = "authentic, and yet no message"


#: How many datagrams were dropped, and why.
Drops = Counter[Drop]
