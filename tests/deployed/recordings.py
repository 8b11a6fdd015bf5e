"""What robots' recordings say: their rounds, their statuses, and whether they agree."""

from __future__ import annotations

import ast
import io
import json
import struct
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from msgspec import Struct, field

#: The program whose output `agreement` understands.
LEDGER = Path(__file__).parent / "ledger.krd"


class Said(Struct, frozen=True):
    """A robot's round: which event it ran, and what it said (`ledger.krd`)."""

    round: int
    event: str | None
    late: bool
    found: int | None = None
    lost: int | None = None


class Recording(Struct):
    """What one process of a robot has recorded so far."""

    rounds: list[Said] = field(default_factory=list)
    statuses: list[dict[str, Any]] = field(default_factory=list)

    @property
    def status(self) -> dict[str, Any]:
        """The last status; empty if there is none."""
        return self.statuses[-1] if self.statuses else {}


def read(path: Path) -> Recording | None:
    """What has been recorded; None while nothing can be read."""
    from mcap.exceptions import McapError
    from mcap.reader import make_reader

    made = Recording()
    try:
        file = io.BytesIO(path.read_bytes())
        messages = list(make_reader(file).iter_messages(log_time_order=False))
    except (OSError, McapError, ValueError, EOFError, struct.error):
        return None  # it is not there yet, or is being written just now
    for _, channel, message in messages:
        told = json.loads(message.data)
        if channel.topic == "/status":
            made.statuses.append(told)
        elif channel.topic.startswith("/robots/"):
            values = [ast.literal_eval(one["values"]) for one in told["output"]]
            found, lost = values[0] if values else (None, None)
            made.rounds.append(Said(told["round"], told["event"], told["late"], found, lost))
    return made


def disagreements(recordings: Iterable[tuple[int, Recording]]) -> list[str]:
    """How the recordings of all processes of a run contradict each other; each is with its pid."""
    found: dict[int, tuple[int, int | None]] = {}
    whose: dict[tuple[int, int], Said] = {}
    told: list[str] = []
    for pid, recording in recordings:
        told += _of_one(pid, recording.rounds)
        for said in recording.rounds:
            before = whose.setdefault((pid, said.round), said)
            # A robot that has lost what it did knows from the others which event that was.
            values = {before.found, said.found} - {None}
            if before.event != said.event or len(values) > 1:
                told.append(f"robot {pid} did round {said.round} twice: {before}, {said}")
            if said.found is None:
                continue
            other, value = found.setdefault(said.round, (pid, said.found))
            if value != said.found:
                told.append(
                    f"in round {said.round} robot {other} found {value}, robot {pid} {said.found}"
                )
    return told


def _of_one(pid: int, rounds: Sequence[Said]) -> list[str]:
    """How a process contradicts itself."""
    told = [
        f"robot {pid} went from round {before.round} to {after.round}"
        for before, after in pairwise(rounds)
        if after.round <= before.round
    ]
    told += [
        f"robot {pid} has lost {said.lost} of its own turns in round {said.round}"
        for said in rounds
        if said.lost
    ]
    return told
