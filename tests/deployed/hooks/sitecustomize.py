"""What a robot's process gets to believe: Python imports this file at its start, by its name."""

import os
import time

_SHIFT_S = float(os.environ.get("KOORD_TEST_CLOCK_SHIFT_S", "0"))

if _SHIFT_S:
    _time, _time_ns, _clock_gettime = time.time, time.time_ns, time.clock_gettime

    def _shifted(clock: int) -> float:
        return _clock_gettime(clock) + (_SHIFT_S if clock == time.CLOCK_REALTIME else 0.0)

    time.time = lambda: _time() + _SHIFT_S
    time.time_ns = lambda: _time_ns() + int(_SHIFT_S * 1e9)
    time.clock_gettime = _shifted
