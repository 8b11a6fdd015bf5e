"""What the robots of a run would send and receive, had they agreed on its rounds by messages.

The messages are those of a round without loss (R-BEGIN) (R-DECIDE) (R-ACCEPT) (R-MAJORITY): each
follower proposes to the coordinator and acknowledges its decision; the coordinator tells all others
what is decided, and that it is committed. They are encoded as robots encode them, so that packets
and bytes are those of a deployed run in which nothing is late or lost. Handshakes and beacons
(R-JOIN) (P-BEACON) are not counted, nor are the headers of the network.
"""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.encoding import encode
from koord.runtime.proposals import Decision, Proposal
from koord.runtime.protocol.messages import (
    GENESIS,
    Acknowledge,
    Committed,
    Decide,
    LogEntry,
    Propose,
)
from koord.runtime.store import DIGEST_BYTES, is_digested
from koord.runtime.wire.frames import HEADER_BYTES, PROOF_BYTES, ROOM

#: The coordinator of a run in which nobody is lost.
_FIRST, _EPOCH = 0, 0

#: Around each piece of a message.
_AROUND = HEADER_BYTES + PROOF_BYTES

#: Instead of digests, whose values change no length.
_DIGEST = bytes(DIGEST_BYTES)


class Traffic(Struct, frozen=True):
    """What all robots of a run send and receive. What is told to all is sent once.

    Packets are datagrams; long messages travel in several.
    """

    packets_sent: int = 0
    packets_received: int = 0
    bytes_sent: int = 0
    bytes_received: int = 0


class TrafficMeter:
    """The count of what the robots of a run would send, round by round."""

    def __init__(self, robots: int) -> None:
        self._robots = robots
        self._followers = robots - 1
        #: The bytes that pids of all followers take up in their proposals.
        self._pids_bytes = sum(map(_bytes, range(1, robots)))
        self.traffic = Traffic()

    def note(self, decision: Decision, proposals: Mapping[int, Proposal]) -> None:
        """Count the messages of a round; who has no proposal proposes nothing to do."""
        if not self._followers:
            return  # who is alone agrees with itself
        round_, many = decision.round, self._followers
        idle = _bytes(Propose(Proposal(_FIRST, round_))) - _bytes(_FIRST)
        packets, size = many, many * (idle + _AROUND) + self._pids_bytes
        for pid, proposal in proposals.items():
            if pid != _FIRST and (proposal.attempts or proposal.urgent):
                body = _bytes(Propose(proposal))
                pieces = _pieces(body)
                packets += pieces - 1
                size += body - idle - _bytes(pid) + (pieces - 1) * _AROUND
        acknowledged = _AROUND + _bytes(Acknowledge(_EPOCH, round_, GENESIS))
        packets, size = packets + many, size + many * acknowledged
        if is_digested(round_, self._robots) and decision.fault is None:
            decision = replace(decision, digest=_DIGEST)
        decided = _bytes(Decide(_EPOCH, LogEntry(decision)))
        told = _pieces(decided) + 1
        told_size = decided + _bytes(Committed(_EPOCH, round_, GENESIS)) + told * _AROUND
        so_far = self.traffic
        self.traffic = Traffic(
            so_far.packets_sent + packets + told,
            so_far.packets_received + packets + many * told,
            so_far.bytes_sent + size + told_size,
            so_far.bytes_received + size + many * told_size,
        )


def _bytes(value: object) -> int:
    return len(encode(value))


def _pieces(size: int) -> int:
    """The datagrams of a message. (``koord.runtime.wire.codec.cut``)"""
    return max(1, -(-size // ROOM))
