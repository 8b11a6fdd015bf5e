"""Links to autopilots: messages in, messages out, without waiting."""

from __future__ import annotations

import select
import time
from typing import Protocol

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.mavlink.library import Message, mavlink, mavutil
from koord.runtime.drivers.mavlink.options import MavlinkOptions

#: Who sends more between two ticks is read on at the next one.
_MOST_READS, _MOST_BYTES = 500, 4096


class Link(Protocol):
    """A link to one autopilot."""

    def receive(self) -> list[Message]:
        """What has arrived since the last time."""

    def send(self, message: Message) -> None:
        """Pass a message on; what cannot be sent is lost."""

    def wait(self, most_s: float) -> float:
        """Wait until something arrives, at the beginning alone; return for how long, in s."""

    def close(self) -> None:
        """Let go of it."""


class Codec:
    """Messages as bytes, of MAVLink 2, and back."""

    def __init__(self, system: int, component: int) -> None:
        """Make a codec for what a system sends."""
        self._codec = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self._codec.robust_parsing = True

    def encoded(self, message: Message) -> bytes:
        """The bytes of a message, with the next number of this sender."""
        data: bytes = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        return data

    def decoded(self, data: bytes) -> list[Message]:
        """The messages that end in these bytes; what is none is left out."""
        found = self._codec.parse_buffer(data) or []
        return [one for one in found if one.get_type() != "BAD_DATA"]


class WireLink:
    """A link over UDP or a serial line."""

    def __init__(self, options: MavlinkOptions) -> None:
        """Open it. Raises DriverError."""
        word, _, place = options.connection.partition(":")
        baud = 0
        if word == "serial":
            place, _, number = place.rpartition(":")
            baud = int(number)
        try:
            self._wire = mavutil.mavlink_connection(
                place if word == "serial" else options.connection,
                baud=baud,
                source_system=options.ground_system,
                retries=0,
            )
        except ImportError as error:
            library = "pyserial" if word == "serial" else error.name
            hint = f"install it with: pip install {library}"
            raise DriverError(f"{library} is needed for `{options.connection}`", hint) from None
        except (OSError, ValueError) as error:
            text = f"cannot open `{options.connection}`: {error}"
            raise DriverError(text, "see `connection` of the vehicle") from None
        self._codec = Codec(options.ground_system, mavlink.MAV_COMP_ID_MISSIONPLANNER)

    def receive(self) -> list[Message]:
        found: list[Message] = []
        for _ in range(_MOST_READS):
            try:
                data = self._wire.recv(_MOST_BYTES)
            except OSError:
                break  # it is silent: that is noticed by its heartbeat
            if not data:
                break
            found += self._codec.decoded(data)
        return found

    def send(self, message: Message) -> None:
        try:
            self._wire.write(self._codec.encoded(message))
        except OSError:
            return  # it is told again at the next tick

    def wait(self, most_s: float) -> float:
        begun_s = time.monotonic()
        select.select([self._wire.fd], [], [], most_s)
        return time.monotonic() - begun_s

    def close(self) -> None:
        self._wire.close()
