"""The runs of a campaign as a Parquet file: what tables of data are read from. Needs ``pyarrow``.

Such a file is readable with its end only. So it is written anew as a whole while runs end, each
time in the place of the last: whoever reads it meanwhile reads a table that is whole.
"""

from __future__ import annotations

import io
import os
import time
from collections.abc import Sequence
from types import NoneType
from typing import Any, get_args, get_type_hints

import msgspec

from koord.api.campaign_runs import COLUMNS, Row, RunFile
from koord.api.files import read_written, write_atomically

#: It is written so often at most, in seconds; and writing takes at most such a share of the time.
_PERIOD_S, _SHARE = 1.0, 0.05


class ParquetFile(RunFile):
    """The Parquet file of a campaign. What ends a run meanwhile takes at most the last rows along.

    Where there is a CSV file as well, whatever stands in one of the two is known.
    """

    def __init__(self, path: str, campaign: str, *, resumes: bool) -> None:
        super().__init__(path, campaign, resumes=resumes)
        self._new: list[Row] = []
        self._due_s, self._is_behind = 0.0, False

    def __exit__(self, *_: object) -> None:
        if self._is_behind:
            self._keep([*self.rows, *self._new])

    def add(self, row: Row) -> None:
        """Note a run, and write all if that is due. Raises KoordError."""
        self._new.append(row)
        self._is_behind = True
        began_s = time.monotonic()
        if began_s >= self._due_s:
            self._keep([*self.rows, *self._new])
            now_s = time.monotonic()
            self._due_s = now_s + max(_PERIOD_S, (now_s - began_s) / _SHARE)

    def finish(self, rows: Sequence[Row]) -> None:
        """Write all runs in their order. Raises KoordError."""
        self._keep(rows)

    def _keep(self, rows: Sequence[Row]) -> None:
        write_atomically(self._path, self._written(rows))
        self._is_behind = False

    # --- inside -----------------------------------------------------------------------------------

    def _there(self) -> list[Row] | None:
        if not os.path.isfile(self._path):
            return []
        raw = read_written(self._path)
        try:
            table = _library("parquet").read_table(io.BytesIO(raw))
            if table.column_names != COLUMNS:
                return None
            rows = []
            for cells in table.to_pylist():
                if cells.pop("campaign") != self._campaign:
                    return None
                rows.append(msgspec.convert(cells, Row))
        except (ValueError, OSError):  # what the library and msgspec raise: no such file
            return None
        return rows

    def _written(self, rows: Sequence[Row]) -> bytes:
        lines = [self._cells(row) for row in rows]
        columns = {name: [line[k] for line in lines] for k, name in enumerate(COLUMNS)}
        file = io.BytesIO()
        table = _library().table(columns, schema=_schema())
        _library("parquet").write_table(table, file)
        return file.getvalue()


def _library(part: str = "") -> Any:
    """The library, which says nothing of its types, or a part of it."""
    from importlib import import_module

    return import_module(f"pyarrow.{part}" if part else "pyarrow")


def _schema() -> Any:
    """The columns with their types; what a run may have none of may be null."""
    arrow, hints = _library(), get_type_hints(Row)
    types = {str: arrow.string(), int: arrow.int64(), float: arrow.float64()}
    fields = [arrow.field("campaign", arrow.string(), nullable=False)]
    for name in COLUMNS[1:]:
        parts = get_args(hints[name]) or (hints[name],)
        (kind,) = (part for part in parts if part is not NoneType)
        fields.append(arrow.field(name, types[kind], nullable=NoneType in parts))
    return arrow.schema(fields)
