"""A deployed run as MCAP: what each robot did in each round. Needs ``koord[record]``."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import IO, Any

from koord.runtime.deploy.running import Moment
from koord.runtime.deploy.status import Status

_SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {
        "round": {"type": "integer"},
        "event": {"type": ["string", "null"]},
        "position": {"type": "array", "items": {"type": "number"}},
        "late": {"type": "boolean"},
        "took_s": {"type": "number"},
        "output": {"type": "array", "items": {"type": "object"}},
    },
}


class NoLibraryError(Exception):
    """The library for MCAP is not installed."""


class Record:
    """An MCAP file; one channel of JSON for each robot (``/robots/0``), one for their statuses."""

    def __init__(self, file: IO[bytes]) -> None:
        """Raises NoLibraryError."""
        try:
            from mcap.writer import Writer
        except ImportError as error:
            raise NoLibraryError from error
        self._writer: Any = Writer(file)
        self._writer.start(profile="", library="koord")
        self._channels: dict[str, int] = {}

    def moments(self, moments: tuple[Moment, ...], now_ns: int) -> None:
        """What a robot did."""
        for moment in moments:
            said = [{"stream": w.stream, "values": repr(w.values)} for w in moment.output]
            message = {
                "round": moment.round,
                "event": moment.event,
                "position": list(moment.position),
                "late": moment.late,
                "took_s": moment.took_s,
                "output": said,
            }
            self._add(f"/robots/{moment.pid}", message, now_ns, moment.round)

    def status(self, status: Status, now_ns: int) -> None:
        """How a robot is doing."""
        message = asdict(status)
        message["holding"] = None if status.holding is None else status.holding.value
        self._add("/status", message, now_ns, status.round)

    def _add(self, topic: str, message: dict[str, Any], now_ns: int, sequence: int) -> None:
        if topic not in self._channels:
            schema = _SCHEMA if topic.startswith("/robots/") else {"type": "object"}
            data = json.dumps(schema).encode()
            number = self._writer.register_schema(
                name=f"koord{topic.rstrip('0123456789').rstrip('/').replace('/', '.')}",
                encoding="jsonschema",
                data=data,
            )
            self._channels[topic] = self._writer.register_channel(
                topic=topic, message_encoding="json", schema_id=number
            )
        self._writer.add_message(
            channel_id=self._channels[topic],
            log_time=now_ns,
            publish_time=now_ns,
            sequence=max(sequence, 0),
            data=json.dumps(message).encode(),
        )

    def close(self) -> None:
        """Finish the file."""
        self._writer.finish()
