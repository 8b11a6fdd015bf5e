"""Canonical encoding of plain data: equal data give equal bytes, for digests and datagrams.

MessagePack, written and read by msgspec, which checks types, lengths and nesting while it reads.
Whole numbers of more than 64 bits, which MessagePack lacks, are an extension of it.
"""

from __future__ import annotations

from typing import Any

import msgspec

from koord.runtime.proposals import (
    Admitted,
    Attempt,
    Decision,
    EventFault,
    Faulted,
    Plain,
    Proposal,
    StopRequests,
    Write,
)
from koord.syntax.faults import FaultKind

#: The code of the extension: a whole number in two's complement, the greatest byte first.
BIG_INT = 1

#: Numbers longer than this are not read: adding two of them would take the time of a round.
MOST_BIG_INT_BYTES = 1 << 16

_FAULT_KINDS = tuple(FaultKind)

_SCALARS = (bool, int, float, str, type(None))

# What is written, as types that msgspec checks: tuples instead of named fields, to save bytes.
FlatWrite = tuple[int, tuple[Any, ...], Any]
FlatFault = tuple[int, str, str]
FlatAttempt = tuple[int | None, tuple[FlatWrite, ...], tuple[int, ...], int, FlatFault | None]
FlatProposal = tuple[int, int, tuple[FlatAttempt, ...], bool]
FlatTaken = tuple[int, int | None, int]
FlatFaulted = tuple[int, int | None, FlatFault]
FlatDecision = tuple[
    int, tuple[FlatTaken, ...], tuple[int, ...], tuple[FlatWrite, ...], bytes, FlatFaulted | None
]

_ENCODER = msgspec.msgpack.Encoder()


class NotPlainError(ValueError):
    """Raised for MessagePack data of the right type that no robot can have sent."""


def encode(flat: Any) -> bytes:
    """Encode tuples of scalars and bytes as MessagePack."""
    try:
        return _ENCODER.encode(flat)
    except OverflowError:
        return _ENCODER.encode(_with_big_ints(flat))


def _with_big_ints(flat: Any) -> Any:
    if isinstance(flat, tuple):
        return tuple(_with_big_ints(item) for item in flat)
    if isinstance(flat, int) and not -(2**63) <= flat < 2**64:
        size = flat.bit_length() // 8 + 1
        return msgspec.msgpack.Ext(BIG_INT, flat.to_bytes(size, "big", signed=True))
    return flat


def big_int(code: int, data: memoryview) -> int:
    """Decode a big integer: the ``ext_hook`` of a decoder. Raises NotPlainError."""
    if code != BIG_INT or not 0 < len(data) <= MOST_BIG_INT_BYTES:
        raise NotPlainError(f"extension {code} of {len(data)} bytes")
    return int.from_bytes(data, "big", signed=True)


def plain(value: Any) -> Plain:
    """Convert decoded lists to tuples. Raises NotPlainError for types that Koord lacks."""
    if isinstance(value, list | tuple):
        return tuple(plain(item) for item in value)
    if isinstance(value, _SCALARS):
        return value
    raise NotPlainError(f"a {type(value).__name__}")


# --- proposals and decisions ----------------------------------------------------------------------


def flat_proposal(proposal: Proposal) -> FlatProposal:
    attempts = tuple(_flat_attempt(attempt) for attempt in proposal.attempts)
    return proposal.robot, proposal.round, attempts, proposal.urgent


def proposal_of(flat: FlatProposal) -> Proposal:
    """Decode a proposal. Raises NotPlainError."""
    robot, round_, attempts, urgent = flat
    return Proposal(robot, round_, tuple(_attempt_of(a) for a in attempts), urgent)


def flat_decision(decision: Decision) -> FlatDecision:
    faulted = decision.fault
    return (
        decision.round,
        tuple((t.robot, t.event, t.asked.value) for t in decision.ran),
        decision.skipped,
        tuple((w.variable, w.path, w.value) for w in decision.writes),
        decision.digest,
        None if faulted is None else (faulted.robot, faulted.event, flat_fault(faulted.fault)),
    )


def decision_of(flat: FlatDecision) -> Decision:
    """Decode a decision. Raises NotPlainError."""
    round_, ran, skipped, writes, digest, faulted = flat
    return Decision(
        round_,
        tuple(Admitted(robot, event, _asked_of(asked)) for robot, event, asked in ran),
        skipped,
        tuple(_write_of(w) for w in writes),
        digest,
        None if faulted is None else Faulted(faulted[0], faulted[1], fault_of(faulted[2])),
    )


def _flat_attempt(attempt: Attempt) -> FlatAttempt:
    writes = tuple((w.variable, w.path, w.value) for w in attempt.writes)
    fault = None if attempt.fault is None else flat_fault(attempt.fault)
    return attempt.event, writes, attempt.locks, attempt.asked.value, fault


def _attempt_of(flat: FlatAttempt) -> Attempt:
    event, writes, locks, asked, fault = flat
    return Attempt(
        event,
        tuple(_write_of(w) for w in writes),
        locks,
        _asked_of(asked),
        None if fault is None else fault_of(fault),
    )


def _write_of(flat: FlatWrite) -> Write:
    variable, path, value = flat
    return Write(variable, tuple(plain(step) for step in path), plain(value))


def _asked_of(number: int) -> StopRequests:
    try:
        return StopRequests(number)
    except ValueError as error:
        raise NotPlainError(f"asked {number}") from error


def flat_fault(fault: EventFault) -> FlatFault:
    return _FAULT_KINDS.index(fault.kind), fault.place, fault.detail


def fault_of(flat: FlatFault) -> EventFault:
    kind, place, detail = flat
    if not 0 <= kind < len(_FAULT_KINDS):
        raise NotPlainError(f"kind of fault {kind}")
    return EventFault(_FAULT_KINDS[kind], place, detail)
