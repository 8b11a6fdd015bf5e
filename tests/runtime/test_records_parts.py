"""A recording is a whole MCAP file each time that it was flushed."""

from __future__ import annotations

import errno
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import SeekingReader, make_reader
from mcap.records import Footer, Message
from mcap.stream_reader import StreamReader

from koord.runtime.records import RecordFile

MAGIC = b"\x89MCAP0\r\n"
SCHEMA = ("number", {"type": "object"})


def times(data: bytes) -> list[int]:
    reader = make_reader(io.BytesIO(data))
    assert isinstance(reader, SeekingReader)
    found = [message.log_time for _, _, message in reader.iter_messages()]
    # Who reads it from its beginning to its end finds the same, and nothing behind its end.
    records = list(StreamReader(io.BytesIO(data)).records)
    assert [record.log_time for record in records if isinstance(record, Message)] == found
    assert [k for k, record in enumerate(records, 1) if isinstance(record, Footer)] == [
        len(records)
    ]
    assert not data.partition(MAGIC)[2].removesuffix(MAGIC).count(MAGIC)
    return found


def test_it_is_whole_after_each_flush(tmp_path: Path) -> None:
    path, once = tmp_path / "a.mcap", io.BytesIO()
    whole = RecordFile(once)
    with path.open("wb") as file:
        growing = RecordFile(file)
        for number in range(6):
            for one in (growing, whole):
                one.add(f"/t{number % 2}", SCHEMA, {"n": number}, number)
            if number % 3 != 1:
                growing.flush()
                assert times(path.read_bytes()) == list(range(number + 1))
        growing.flush()  # nothing is new
        assert times(path.read_bytes()) == list(range(6))
        growing.close()
    whole.close()
    assert times(path.read_bytes()) == times(once.getvalue()) == list(range(6))


def flushed(recording: RecordFile, numbers: Iterable[int]) -> None:
    for number in numbers:
        recording.add("/t", SCHEMA, {"n": number}, number)
        recording.flush()


class Full(io.FileIO):
    """A file on a disk with so little room."""

    room = 0

    def write(self, data: Any) -> int:
        left = self.room - self.tell()
        if left <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(bytes(data)[:left])


@pytest.mark.parametrize("beyond", [0, 1, 50, 250, 400])
def test_where_there_is_no_room_it_ends_with_the_last_flush(tmp_path: Path, beyond: int) -> None:
    """Wherever the disk is full: among messages, in the summary behind them, or at their end."""
    path = tmp_path / "a.mcap"
    with Full(path, "w") as file:
        file.room = 1 << 20
        growing = RecordFile(file)
        flushed(growing, range(4))
        whole = path.read_bytes()
        file.room = file.tell() + beyond
        with pytest.raises(OSError, match="No space"):
            flushed(growing, range(4, 2_000))
        file.room = len(whole)
        growing.restore()
    found = times(path.read_bytes())
    assert found == list(range(len(found)))
    assert len(found) >= 4
