"""A recording is a whole MCAP file each time that it was flushed."""

from __future__ import annotations

import io
from pathlib import Path

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
