"""Localisers: how old a frame of NatNet is when a driver has sensed it, and what that takes.

A fake server in a process of its own sends a hundred frames a second, with stamps of the clock that
all processes of this machine share. It is looked for all the time, and as robots do: twenty times a
second, where the newest frame is up to a frame old already.
"""

from __future__ import annotations

import sys
import time
from typing import Any

from harness import ROOT, Column, Report, limited, main, note

#: What is wanted: a frame is sensed soon where it is looked for, and within a tick else.
SENSED_S, TICK_S = 0.005, 0.05

#: How frames go, and how many bodies are in each.
CASES = (("unicast", 3), ("unicast", 20), ("multicast", 3), ("multicast", 20))

SECONDS, QUICK_S = 10.0, 1.0


def server(way: str, bodies: int) -> Any:
    """A fake server as a process, which sees so many bodies."""
    from koord.testing.natnet.packets import Stream
    from koord.testing.natnet.serving import Settings
    from tests.runtime.platform.natnets import serving

    stream = Stream() if way == "unicast" else Stream(15_311, "239.255.42.97")
    names = ("car", *(f"body{k}" for k in range(1, bodies)))
    return serving(Settings(names, stream=stream))


def sensed(port: int, pause_s: float, seconds: float) -> tuple[list[float], list[float]]:
    """Seconds from the sending of each frame until it is sensed, and that each look took."""
    from tests.runtime.platform.natnets import localiser

    made = localiser("127.0.0.1", port=port)
    made.open(time.monotonic())
    late: list[float] = []
    took: list[float] = []
    before, ends_s = None, time.monotonic() + seconds
    while time.monotonic() < ends_s:
        begun_s = time.monotonic()
        located = made.locate(begun_s)
        done_s = time.monotonic()
        took.append(done_s - begun_s)
        frame = made._frame
        if located is not None and frame is not None and frame != before:
            before = frame
            late.append(done_s - frame[1] / 1e9)  # exposed and sent at once
        time.sleep(max(0.0, pause_s - (time.monotonic() - begun_s)))
    made.close()
    return late[len(late) // 10 :], took


def spread(seconds: list[float]) -> dict[str, float]:
    """Median, and what 99 of 100 keep to, in ms."""
    sorted_ms = [1e3 * one for one in sorted(seconds)]
    return {"median": sorted_ms[len(sorted_ms) // 2], "p99": sorted_ms[len(sorted_ms) * 99 // 100]}


def benchmark(report: Report) -> None:
    table = report.table(
        "From a frame that is sent to what is sensed, ms",
        Column("way", "frames go by"),
        Column("bodies", "bodies"),
        Column("looks", "looked for"),
        Column("median", "median", 2),
        Column("p99", "99 %", 2),
        Column("look", "a look takes", 3),
        Column("limit", "limit"),
        Column("met", "met"),
    )
    seconds = QUICK_S if report.quick else SECONDS
    sys.path.insert(0, str(ROOT))
    for way, bodies in CASES:
        note(f"{bodies} bodies by {way}")
        with server(way, bodies) as served:
            served.tell(body="car", position=[1.0, 2.0, 0.0])
            for looks, pause_s, most_s in (
                ("all the time", 0.0005, SENSED_S),
                ("each tick", TICK_S, TICK_S),
            ):
                late, took = sensed(served.port, pause_s, seconds)
                report.expect(bool(late), f"{bodies} bodies by {way}: no frame was heard")
                if not late:
                    continue
                found = spread(late)
                table.rows.append(
                    {
                        **{"way": way, "bodies": bodies, "looks": looks, **found},
                        "look": spread(took)["median"],
                        **limited(found["median"] / 1e3, most_s, "s median"),
                    }
                )


if __name__ == "__main__":
    sys.exit(main("localisers", __doc__ or "", benchmark))
