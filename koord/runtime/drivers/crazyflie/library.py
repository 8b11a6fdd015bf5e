"""cflib, the library of Crazyflies; who has not got it is told how to install it."""

from __future__ import annotations

import logging
from importlib import import_module
from typing import Any

from koord.runtime.motion.libraries import require

require(("cflib",), "crazyflie")

# What goes wrong comes by callbacks; its log would show people tracebacks besides.
logging.getLogger("cflib").addHandler(logging.NullHandler())

crtp: Any = import_module("cflib.crtp")
Crazyflie: Any = import_module("cflib.crazyflie").Crazyflie
LogConfig: Any = import_module("cflib.crazyflie.log").LogConfig
CRTPPacket: Any = import_module("cflib.crtp.crtpstack").CRTPPacket
CRTPPort: Any = import_module("cflib.crtp.crtpstack").CRTPPort
