"""pymavlink, the library of MAVLink; who has not got it is told how to install it.

``mavlink`` has the messages and constants of MAVLink 2, ``mavutil`` wires and modes.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from koord.runtime.motion.libraries import require

require(("pymavlink",), "mavlink")

mavlink: Any = import_module("pymavlink.dialects.v20.common")
mavutil: Any = import_module("pymavlink.mavutil")

#: A message of MAVLink, as pymavlink has it.
Message = Any
