"""The runs of a campaign as Parquet: what is read is what the CSV file says."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import msgspec
import pytest

from koord.api import campaign_parquet
from koord.api.campaign import CampaignBegun, RunOver, campaign
from koord.api.campaign_parquet import ParquetFile
from koord.api.campaign_runs import COLUMNS, Row
from koord.api.progress import Progress
from koord.api.results import ArgumentError
from koord.syntax.diagnostics import KoordError

arrow: Any = pytest.importorskip("pyarrow")
parquet: Any = pytest.importorskip("pyarrow.parquet")

#: Columns of what was measured, which differ from run to run.
MEASURED = ("wall_s", "cpu_s", "memory_mib", "threads")

PROGRAM = Path(__file__).parents[2] / "specs" / "examples" / "follow_path.krd"


class EndedError(Exception):
    """Raised by who listens to a campaign, after so many runs."""


def made(table: Path, runs: int, after: int | None = None, **more: Any) -> list[Progress]:
    """A campaign; what was heard of it."""
    heard = list[Progress]()

    def hear(progress: Progress) -> None:
        heard.append(progress)
        if isinstance(progress, RunOver) and progress.done == after:
            raise EndedError

    campaign(PROGRAM, runs=runs, seed=0, duration_s=0.2, parquet=table, progress=hear, **more)
    return heard


def rows(table: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = parquet.read_table(table).to_pylist()
    return found


def timeless(found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{name: cell for name, cell in row.items() if name not in MEASURED} for row in found]


def test_the_table_says_what_the_lines_say(tmp_path: Path) -> None:
    table, lines = tmp_path / "runs.parquet", tmp_path / "runs.csv"
    made(table, 4, csv=lines)
    found = rows(table)
    assert [row["seed"] for row in found] == [0, 1, 2, 3]
    with lines.open(encoding="utf-8", newline="") as file:
        told = list(csv.DictReader(file))
    for row, line in zip(found, told, strict=True):
        assert {name: "" if v is None else str(v) for name, v in row.items()} == line
    schema = parquet.read_schema(table)
    assert schema.names == COLUMNS
    assert schema.field("seed").type == arrow.int64()
    assert schema.field("separation_m").nullable
    assert not schema.field("distance_m").nullable


def test_rows_are_there_while_runs_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign_parquet, "_PERIOD_S", 0.0)
    monkeypatch.setattr(campaign_parquet, "_SHARE", 1e9)
    table, seen = tmp_path / "runs.parquet", list[int]()

    def look(progress: Progress) -> None:
        if isinstance(progress, RunOver):
            seen.append(len(rows(table)))

    campaign(PROGRAM, runs=3, seed=0, duration_s=0.2, parquet=table, progress=look)
    assert seen == [1, 2, 3]


@pytest.mark.parametrize("also_csv", [False, True])
def test_a_campaign_that_was_ended_goes_on(also_csv: bool, tmp_path: Path) -> None:
    table, whole = tmp_path / "runs.parquet", tmp_path / "whole.parquet"
    more: dict[str, Any] = {"csv": tmp_path / "runs.csv"} if also_csv else {}
    with pytest.raises(EndedError):
        made(table, 5, after=3, **more)
    before = rows(table)
    assert [row["seed"] for row in before] == [0, 1, 2]
    with pytest.raises(KoordError, match="3 of the 5 runs"):
        made(table, 5, **more)
    heard = made(table, 5, resume=True, **more)
    assert [one.known for one in heard if isinstance(one, CampaignBegun)] == [3]
    made(whole, 5)
    assert rows(table)[:3] == before
    assert timeless(rows(table)) == timeless(rows(whole))


def test_what_one_of_two_files_has_is_not_made_again(tmp_path: Path) -> None:
    """`kill -9` takes the last rows of the table along, and none of the lines."""
    table, lines = tmp_path / "runs.parquet", tmp_path / "runs.csv"
    with pytest.raises(EndedError):
        made(table, 5, after=3, csv=lines)
    kept = ParquetFile(str(table), rows(table)[0]["campaign"], resumes=True)
    kept.finish(kept._there()[:1])  # type: ignore[index]
    assert len(rows(table)) == 1
    with pytest.raises(EndedError):
        made(table, 5, after=4, csv=lines, resume=True)
    assert [row["seed"] for row in rows(table)] == [0, 1, 2, 3]
    lines.unlink()
    heard = made(table, 5, csv=lines, resume=True)
    assert [one.known for one in heard if isinstance(one, CampaignBegun)] == [4]
    assert len(lines.read_text("utf-8").splitlines()) == 1 + len(rows(table)) == 6


@pytest.mark.parametrize("raw", [b"", b"PAR1", b"campaign,seed\n", "other", "renamed"])
def test_what_is_no_table_of_this_campaign_is_refused(raw: bytes | str, tmp_path: Path) -> None:
    table = tmp_path / "runs.parquet"
    made(table, 1)
    if raw == "other":
        found = parquet.read_table(table)
        other = arrow.array(["another"], arrow.string())
        parquet.write_table(found.set_column(0, "campaign", other), table)
    elif raw == "renamed":
        names = ["of", *COLUMNS[1:]]
        parquet.write_table(parquet.read_table(table).rename_columns(names), table)
    elif isinstance(raw, bytes):
        table.write_bytes(raw)
    kept = table.read_bytes()
    with pytest.raises(KoordError, match="not of this campaign"):
        made(table, 2, resume=True)
    assert table.read_bytes() == kept


def test_lines_and_table_are_two_files(tmp_path: Path) -> None:
    table = tmp_path / "runs"
    with pytest.raises(ArgumentError, match="is the file of the lines"):
        made(table, 2, csv=tmp_path / "." / "runs")
    assert not table.exists()


def test_every_figure_of_a_run_has_its_column(tmp_path: Path) -> None:
    """Also those that a run may have none of."""
    table = tmp_path / "runs.parquet"
    made(table, 1)
    (row,) = rows(table)
    row.pop("campaign")
    full = msgspec.convert(row | {"tasks_s": 1.5, "separation_m": 0.25, "swept": "ä,\n"}, Row)
    bare = msgspec.structs.replace(full, tasks_s=None, separation_m=None, swept="")
    file = ParquetFile(str(table), "a campaign", resumes=False)
    file.finish([full, bare])
    assert file._there() == [full, bare]
    file.finish([])
    assert file._there() == []
