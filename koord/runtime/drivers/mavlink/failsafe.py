"""Whether an autopilot acts by itself when koord falls silent, as its parameters say."""

from __future__ import annotations

import math

from koord.runtime.drivers.mavlink.library import Message, mavlink
from koord.runtime.drivers.mavlink.options import AutopilotKind, MavlinkOptions

#: It is asked so often, in s, and so many times: some wires let no parameters through.
_EVERY_S, _TIMES = 1.0, 10

#: Numbers on the wire have 24 bits.
_ROUNDING = 1.001


class FailsafeCheck:
    """Asks for the parameter that the failsafe rests on, and judges it. (M-FAILSAFE)"""

    def __init__(self, options: MavlinkOptions) -> None:
        self._options = options
        is_px4 = options.autopilot is AutopilotKind.PX4
        self._name = "COM_OF_LOSS_T" if is_px4 else "FS_GCS_ENABLE"
        self._value: float | None = None
        self._asked, self._asked_s = 0, -math.inf

    def ask(self, now_s: float) -> Message | None:
        """The question, if it is due."""
        is_over = self._value is not None or self._asked == _TIMES
        if is_over or now_s - self._asked_s < _EVERY_S:
            return None
        self._asked, self._asked_s = self._asked + 1, now_s
        target = self._options.system, mavlink.MAV_COMP_ID_AUTOPILOT1
        return mavlink.MAVLink_param_request_read_message(*target, self._name.encode(), -1)

    def hear(self, message: Message) -> None:
        """Take note of a PARAM_VALUE."""
        if message.param_id == self._name:
            self._value = float(message.param_value)

    @property
    def trouble(self) -> str | None:
        """What is wrong with the failsafe; None if nothing is known to be."""
        value, silence_s = self._value, self._options.silence
        if value is None:
            return None
        if self._options.autopilot is AutopilotKind.ARDUPILOT:
            flies_on = f"its {self._name} is 0: it does nothing if koord falls silent"
            return flies_on if value == 0 else None
        if value <= silence_s * _ROUNDING:
            return None
        return f"its {self._name} is {value:g} s, and the option `silence` {silence_s:g} s"
