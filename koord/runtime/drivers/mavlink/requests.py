"""Commands to an autopilot: repeated until they are acknowledged, and what it said to them."""

from __future__ import annotations

import math
from collections.abc import Iterator

from msgspec import Struct

from koord.runtime.drivers.mavlink.library import Message, mavlink
from koord.runtime.drivers.mavlink.options import MavlinkOptions

#: A command is repeated after this, in s: if nobody answered, if it was refused, and if it was
#: agreed to and nothing came of it.
_UNANSWERED_S, _REFUSED_S, _AGREED_S = 0.3, 1.0, 2.0

#: Who has not answered so often does not answer.
_PATIENCE = 4

_AGREED = frozenset({mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS})

#: What results mean.
_RESULTS = {
    mavlink.MAV_RESULT_TEMPORARILY_REJECTED: "not now",
    mavlink.MAV_RESULT_DENIED: "denied",
    mavlink.MAV_RESULT_UNSUPPORTED: "it does not know that",
    mavlink.MAV_RESULT_FAILED: "it failed",
}

#: Messages that are asked for, each with its rate in Hz; None: that of the options.
_STREAMS: dict[int, float | None] = {
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: None,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: None,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
}

#: Whoever has sent no pose for so long is asked for it again: it may have been started anew.
_FORGOTTEN_S = 2.0


class Asked(Struct):
    """A command that was sent."""

    parameters: tuple[float, ...]
    at_s: float
    unanswered: int = 0  #: how often it was sent since the last answer
    result: int | None = None  #: the last answer

    @property
    def pause_s(self) -> float:
        """After which it is sent again."""
        if self.unanswered:
            return _UNANSWERED_S
        return _AGREED_S if self.result in _AGREED else _REFUSED_S


class Requests:
    """What was asked of an autopilot. Each command is asked for with one meaning at a time."""

    def __init__(self, options: MavlinkOptions) -> None:
        self._target = options.system, mavlink.MAV_COMP_ID_AUTOPILOT1
        self._asked: dict[int, Asked] = {}
        self._wanted: list[tuple[float, ...]] = [
            (message, 1e6 / (rate_hz or options.telemetry)) for message, rate_hz in _STREAMS.items()
        ]
        self._streams = list(self._wanted)

    def ask(self, command: int, parameters: tuple[float, ...], now_s: float) -> Message | None:
        """The command as a message if it is due: at once, or when the last one had no effect.

        (M-COMMAND)
        """
        asked = self._asked.get(command)
        if asked is None or asked.parameters != parameters:
            asked = self._asked[command] = Asked(parameters, now_s)
        elif now_s - asked.at_s < asked.pause_s:
            return None
        confirmation = min(asked.unanswered, 255)
        asked.unanswered, asked.at_s = asked.unanswered + 1, now_s
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        return mavlink.MAVLink_command_long_message(*self._target, command, confirmation, *padded)

    def forget(self, command: int) -> None:
        """Take what was asked as done, or as no longer wanted."""
        self._asked.pop(command, None)

    def hear(self, acknowledgement: Message) -> None:
        """Take note of a COMMAND_ACK."""
        command = acknowledgement.command
        asked = self._asked.get(command)
        if asked is None:
            return
        asked.result, asked.unanswered = int(acknowledgement.result), 0
        if command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            self._streams = [one for one in self._streams if one != asked.parameters]
            self.forget(command)

    def trouble(self, command: int) -> str | None:
        """Why nothing comes of a command: what the autopilot said, or that it said nothing."""
        asked = self._asked.get(command)
        if asked is None:
            return None
        if asked.unanswered >= _PATIENCE:
            return "no answer"
        if asked.result is None or asked.result in _AGREED:
            return None
        return _RESULTS.get(asked.result, f"result {asked.result}")

    def streams(self, pose_age_s: float, now_s: float) -> Iterator[Message]:
        """Ask for the messages that are needed, one after the other."""
        if not self._streams and math.isfinite(pose_age_s) and pose_age_s > _FORGOTTEN_S:
            self._streams = list(self._wanted)
        if self._streams:
            command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            message = self.ask(command, self._streams[0], now_s)
            if message is not None:
                yield message
