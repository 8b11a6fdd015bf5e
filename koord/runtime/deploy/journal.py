"""Journals: a robot's own state on disk, which survives a crash. (R-SNAPSHOT)

The shared store comes back from the others; a robot's locals, ports and pending proposal are known
to nobody else. A journal is one file that is replaced whole, so it is never half-written.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from koord.runtime.encoding import (
    FlatProposal,
    NotPlainError,
    big_int,
    encode,
    flat_proposal,
    plain,
    proposal_of,
)
from koord.runtime.proposals import Proposal

#: Attributes in the order of the program's locals and ports, each plain.
Attributes = tuple[Any, ...]


class Page(Struct, frozen=True):
    """The state of a robot in its journal.

    It had acted on all rounds before ``round``; ``turns`` environment turns are still to come.
    ``buffers`` are the attributes after each attempt of its last proposal, by event.
    """

    program: str
    round: int
    status: int
    turns: int
    attributes: Attributes
    position: tuple[float, float, float]
    proposal: Proposal | None
    buffers: tuple[tuple[int | None, Attributes], ...]


_Flat = tuple[
    str,
    int,
    int,
    int,
    tuple[Any, ...],
    tuple[float, float, float],
    FlatProposal | None,
    tuple[tuple[int | None, tuple[Any, ...]], ...],
]

_DECODER = msgspec.msgpack.Decoder(_Flat, ext_hook=big_int)


class Journal:
    """The journal file of one robot in one run."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._new = path.with_suffix(".new")

    def write(self, page: Page) -> None:
        """Replace the journal's page. Raises OSError."""
        proposal = None if page.proposal is None else flat_proposal(page.proposal)
        flat = (
            page.program,
            page.round,
            page.status,
            page.turns,
            page.attributes,
            page.position,
            proposal,
            page.buffers,
        )
        self._new.write_bytes(encode(flat))
        os.replace(self._new, self.path)

    def read(self) -> Page | None:
        """The journal's page; None if it is missing or unusable."""
        try:
            flat = _DECODER.decode(self.path.read_bytes())
            program, round_, status, turns, attributes, position, proposal, buffers = flat
            made = None if proposal is None else proposal_of(proposal)
            own = tuple(map(plain, attributes))
            kept = tuple((event, tuple(map(plain, state))) for event, state in buffers)
        except (OSError, msgspec.MsgspecError, NotPlainError, ValueError):
            return None
        return Page(program, round_, status, turns, own, position, made, kept)

    def forget(self) -> None:
        """Remove the journal: the run is over."""
        self.path.unlink(missing_ok=True)
        self._new.unlink(missing_ok=True)
