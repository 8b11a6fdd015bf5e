"""Journals: a robot's own state on disk, which survives a crash. (R-SNAPSHOT)

The shared store comes back from the others; a robot's locals, ports and pending proposal are known
to nobody else. A journal is one file that is replaced whole, so it is never half-written.
"""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from koord.runtime.encoding import decoder, encode
from koord.runtime.proposals import Flat, Plain, Proposal

#: Attributes in the order of the program's locals and ports, each plain.
Attributes = tuple[Plain, ...]


class Page(Flat, frozen=True):
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


_DECODER = decoder(Page)


class Journal:
    """The journal file of one robot in one run."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._new = path.with_suffix(".new")

    def write(self, page: Page) -> None:
        """Replace the journal's page. Raises OSError."""
        self._new.write_bytes(encode(page))
        os.replace(self._new, self.path)

    def read(self) -> Page | None:
        """The journal's page; None if it is missing or unusable."""
        try:
            found: Page = _DECODER.decode(self.path.read_bytes())
        except (OSError, msgspec.MsgspecError, ValueError):
            return None
        return found

    def forget(self) -> None:
        """Remove the journal: the run is over."""
        self.path.unlink(missing_ok=True)
        self._new.unlink(missing_ok=True)
