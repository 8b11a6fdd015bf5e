"""The file of a campaign: a line for each run, there as soon as the run has ended.

A campaign that was ended, however that was, can be resumed: what stands in its file is
not done again. The first column says which campaign a line is of: none gets lines of another.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Collection, Sequence
from typing import BinaryIO, get_type_hints

import msgspec
from msgspec import Struct
from msgspec.structs import astuple

from koord.api.files import read_written, write_atomically
from koord.syntax.diagnostics import refusal

_FAULT = "fault"


class Row(Struct, frozen=True):
    """What a run came to: a line of the CSV file."""

    swept: str
    robots: int
    values: str  #: δ, and each value that is not the text's
    seed: int
    ending: str
    time_s: float
    tasks: int
    tasks_done: int
    tasks_s: float | None
    distance_m: float
    separation_m: float | None
    safety_m: float
    waited_s: float
    events: int
    skips: int
    blocked: int
    messages: int
    broken: int
    stuck: int  #: robots that stand still at the end and should go
    digest: str
    wall_s: float

    @property
    def key(self) -> tuple[str, int]:
        """What tells the runs of a campaign apart."""
        return self.swept, self.seed

    @property
    def taken_s(self) -> float | None:
        """When the last task was visited (None: not all are), or the run over if it has none."""
        return self.tasks_s if self.tasks else self.time_s

    @property
    def is_done(self) -> bool:
        """Whether all tasks were visited, and no fault ended the run."""
        return self.tasks_done == self.tasks and self.ending != _FAULT

    @property
    def is_bad(self) -> bool:
        """Whether a claim was broken, or a fault ended the run."""
        return self.broken > 0 or self.ending == _FAULT


_HINTS = get_type_hints(Row)
_COLUMNS = ["campaign", *Row.__struct_fields__]


class RunFile:
    """The lines of a campaign of this name, which can be read after each."""

    def __init__(self, path: str, campaign: str, *, resumes: bool) -> None:
        self.rows: tuple[Row, ...] = ()  #: of runs that were made before
        self._path, self._campaign, self._resumes = path, campaign, resumes
        self._file: BinaryIO | None = None

    def __enter__(self) -> RunFile:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def begin(self, wanted: Collection[tuple[str, int]]) -> None:
        """Look at what is there of the wanted runs. Nothing is written yet. Raises KoordError."""
        there = self._there()
        self.rows = tuple(row for row in there or () if row.key in wanted)
        if self._resumes and there is None:
            hint = "leave out --resume, or name another file"
            raise refusal("K937", self._path, "its runs are not of this campaign", hint)
        if not self._resumes and 0 < len(self.rows) < len(wanted):
            story = f"it has {len(self.rows)} of the {len(wanted)} runs of this campaign"
            hint = "go on with --resume, or remove the file"
            raise refusal("K937", self._path, story, hint)
        if not self._resumes:
            self.rows = ()

    def add(self, row: Row) -> None:
        """A run has ended: its line is written at once, and as a whole. Raises KoordError."""
        if self._file is None:
            write_atomically(self._path, self._written(self.rows))
        try:
            if self._file is None:
                self._file = open(self._path, "ab", buffering=0)  # noqa: SIM115
            self._file.write(_lines([self._cells(row)]))
        except OSError as error:
            raise refusal("K903", self._path, f"cannot be written: {error.strerror}") from None

    def finish(self, rows: Sequence[Row]) -> None:
        """All runs are there: put them in order. Raises KoordError."""
        if os.path.isfile(self._path):
            write_atomically(self._path, self._written(rows))

    # --- inside ---------------------------------------------------------------------------------

    def _there(self) -> list[Row] | None:
        """The runs that stand in the file; None if it is not of this campaign."""
        if not os.path.isfile(self._path):
            return []
        text = read_written(self._path).decode("utf-8", "replace")
        whole = text[: text.rfind("\n") + 1]  # the last line may have been cut off
        lines = csv.DictReader(io.StringIO(whole))
        if text and lines.fieldnames != _COLUMNS:
            return None
        rows = []
        for cells in lines:
            campaign = cells.pop("campaign", None)
            if campaign != self._campaign:
                return None
            try:
                rows.append(_row(cells))
            except msgspec.ValidationError:
                return None
        return rows

    def _written(self, rows: Sequence[Row]) -> bytes:
        return _lines([_COLUMNS, *map(self._cells, rows)])

    def _cells(self, row: Row) -> list[object]:
        return [self._campaign, *astuple(row)]


def _lines(lines: Sequence[Sequence[object]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(lines)
    return text.getvalue().encode("utf-8")


def _row(cells: dict[str, str]) -> Row:
    """Raises ValidationError."""
    given = {
        name: None if cell == "" and _HINTS.get(name) is not str else cell
        for name, cell in cells.items()
    }
    return msgspec.convert(given, Row, strict=False)
