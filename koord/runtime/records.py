"""MCAP files of JSON messages, for recordings of deployed and simulated runs. Needs ``mcap``."""

from __future__ import annotations

import copy
import heapq
import io
import itertools
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import IO, Any

import msgspec


class _Stream:
    """A file with a tail: the next write overwrites the tail."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file, self._has_tail = file, False
        self._end, self._tail = 0, bytearray()  #: of the last that was complete
        self._is_in_tail = False

    def write(self, data: bytes) -> int:
        if self._is_in_tail:
            self._tail += data
        elif self._has_tail:
            self._file.truncate()
            self._has_tail = False
        written = self._file.write(data)
        while written < len(data):  # of a file without a buffer
            written += self._file.write(data[written:])
        return written

    def tell(self) -> int:
        return self._file.tell()

    def flush(self) -> None:
        self._file.flush()

    @contextmanager
    def tail(self) -> Iterator[bool]:
        """Within the context, writes are the tail. Yields whether a tail is possible: not in a
        pipe.
        """
        if not self._file.seekable():
            self._file.flush()
            yield False
            return
        before, self._tail = self._tail, bytearray()
        end, self._is_in_tail = self._file.tell(), True
        try:
            yield True
            self._file.flush()
        except OSError:
            self._tail = before
            raise
        finally:
            self._is_in_tail = False
        self._file.seek(end)
        self._end, self._has_tail = end, True

    def restore(self) -> None:
        """Take back what was written since there was a tail. Raises OSError."""
        self._file.seek(self._end)
        self._file.truncate()
        self._file.write(self._tail)


class RecordFile:
    """An MCAP file that is being written; a topic is registered with its first message."""

    def __init__(self, file: IO[bytes]) -> None:
        """Open the file. The caller has checked that the library is installed."""
        from mcap.writer import Writer

        self._stream = _Stream(file)
        stream: Any = self._stream  # it has all that writers call
        self._writer: Any = Writer(stream)
        self._writer.start(profile="", library="koord")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def add(
        self,
        topic: str,
        schema: tuple[str, dict[str, Any]],
        message: dict[str, Any] | bytes,
        time_ns: int,
        sequence: int = 0,
    ) -> None:
        """Add a message, which may be encoded; ``schema`` is a unique name and a JSON schema."""
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(
                topic=topic, message_encoding="json", schema_id=self._schema(*schema)
            )
        self._writer.add_message(
            channel_id=self._channels[topic],
            log_time=time_ns,
            publish_time=time_ns,
            sequence=max(sequence, 0),
            data=message if isinstance(message, bytes) else msgspec.json.encode(message),
        )

    def describe(self, name: str, values: dict[str, str]) -> None:
        """Add metadata about the run as a whole."""
        self._writer.add_metadata(name, values)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file that belongs to the run."""
        self._writer.add_attachment(0, 0, name, media_type, data)

    def flush(self) -> None:
        """Flush all messages: the file is complete then, even if this process is killed.

        Its summary and its end are written behind what is there, until more takes their place.
        """
        # The library offers no way to end a chunk before it is full.
        self._writer._Writer__finalize_chunk()
        self._writer._Writer__flush()
        ended = copy.copy(self._writer)
        ended._Writer__summary_offsets = []
        with self._stream.tail() as has_tail:
            if has_tail:
                ended.finish()

    def close(self) -> None:
        """Finish the file."""
        self._writer.finish()

    def restore(self) -> None:
        """Be as complete as after the last flush, for good: of a file that had no room for more.

        The file is one without a buffer. Raises OSError.
        """
        self._stream.restore()

    def _schema(self, name: str, schema: dict[str, Any]) -> int:
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(
                name=name, encoding="jsonschema", data=msgspec.json.encode(schema)
            )
        return self._schemas[name]


class DamagedRecordError(Exception):
    """Raised for a file that is no MCAP file, or is damaged."""


def read_messages(raw: bytes, prefix: str) -> Iterator[tuple[str, bytes]]:
    """Yield the messages of the topics that begin with ``prefix``, in the order of the file.

    The caller has checked that the library is installed. Raises DamagedRecordError.
    """
    from mcap.reader import NonSeekingReader

    reader: Any = NonSeekingReader(io.BytesIO(raw))
    try:
        for _, channel, message in reader.iter_messages(log_time_order=False):
            if channel.topic.startswith(prefix):
                yield channel.topic, message.data
    except Exception as error:  # of the library, of decompression: whatever bytes lead to
        raise DamagedRecordError(str(error) or type(error).__name__) from None


def joined_records(raws: Iterable[bytes]) -> bytes:
    """The messages of recordings as one, in the order of their times.

    What describes the first describes that. The caller has checked that the library is installed.
    Raises DamagedRecordError.
    """
    from mcap.reader import make_reader

    file = io.BytesIO()
    joined = RecordFile(file)
    try:
        readers: list[Any] = [make_reader(io.BytesIO(raw)) for raw in raws]
        for one in itertools.islice(readers, 1):
            for metadata in one.iter_metadata():
                joined.describe(metadata.name, metadata.metadata)
        every = (one.iter_messages() for one in readers)
        for schema, channel, message in heapq.merge(*every, key=lambda one: one[2].log_time):
            form = schema.name, msgspec.json.decode(schema.data)
            joined.add(channel.topic, form, message.data, message.log_time, message.sequence)
    except Exception as error:  # of the library, of decompression: whatever bytes lead to
        raise DamagedRecordError(str(error) or type(error).__name__) from None
    joined.close()
    return file.getvalue()


def is_record(raw: bytes) -> bool:
    """Return whether a file is MCAP, by how it begins."""
    return raw.startswith(b"\x89MCAP")
