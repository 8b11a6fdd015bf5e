"""Recordings: what keeping a run costs, how large its files are, how smoothly its page plays.

Runs are LineForm with 16 drones, where every robot changes its variables in every round: nothing is
dearer to record; and *Squares* with 1,000, of which files are large. Times are CPU seconds in a
child process. Frames are those that a headless Chromium draws without a graphics card while the
page plays.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

from harness import Column, Report, in_child, limited, main, note

#: Robots on a page, and how many frames a second are wanted: as many as a screen shows, less one
#: that comes too late now and then; of a crowd as many as look like motion.
FRAMES = {3: 59.0, 100: 59.0, 1_000: 59.0, 10_000: 20.0}

#: Of what a run takes without being recorded.
MOST_SHARE = 0.10
MOST_MIB = {"run.mcap": 1.0, "run.html": 2.0}

#: A run of many robots, and how long its MCAP file may take to make.
MANY, MANY_S, MOST_MCAP_S = 1_000, 60.0, 1.0


def cost(rounds: int) -> dict[str, Any]:
    """CPU seconds of a run, and how many of them are those of its observer.

    Not the difference of two runs, which on a busy machine is mostly that of the moments at which
    they were made.
    """
    from collections.abc import Callable

    from koord.sim.observing import Observer
    from koord.sim.running import run
    from simulated import begun

    took = 0.0

    def timed(method: Callable[..., None]) -> Callable[..., None]:
        def observe(*arguments: Any) -> None:
            nonlocal took
            began = time.process_time()
            method(*arguments)
            took += time.process_time() - began

        return observe

    simulation = begun("lineform")
    Observer.tick, Observer.round = timed(Observer.tick), timed(Observer.round)  # type: ignore[method-assign]
    began = time.process_time()
    for _ in run(simulation, rounds * simulation.scene.delta_s):
        pass
    return {"recorded_s": time.process_time() - began, "recording_s": took}


def sizes(rounds: int) -> dict[str, Any]:
    """Of each file of a run: its bytes, and the CPU seconds that it takes to make."""
    from koord.sim.files.mcap import mcap_of
    from koord.sim.viewing import page_of
    from tests.sim.recorded import lineform

    recording = lineform(16, rounds).recording
    found = {}
    for name, make in (("run.mcap", mcap_of), ("run.html", page_of)):
        begun = time.process_time()
        found[name] = {"bytes": len(make(recording)), "cpu_s": time.process_time() - begun}
    return found


def of_many(robots: int, seconds: float) -> dict[str, Any]:
    """CPU seconds of the MCAP file of a run of drones on squares, the least of three."""
    from koord.sim.files.mcap import mcap_of
    from koord.sim.running import run
    from simulated import begun

    simulation = begun("squares", "drone", robots)
    for _ in run(simulation, seconds):
        pass
    took = []
    for _ in range(3):
        began = time.process_time()
        file = mcap_of(simulation.recording)
        took.append(time.process_time() - began)
    return {"mib": len(file) / 2**20, "cpu_s": min(took), "time_s": simulation.time_s}


def frames(robots: int, seconds: float) -> dict[str, Any]:
    """Frames a second, and milliseconds of script for each."""
    import tempfile

    from koord.sim.viewing import page_of
    from tests.sim.browser import BROWSER, browser
    from tests.sim.test_page import circling

    if BROWSER is None:
        return {}
    page = page_of(circling(robots, 60.0))
    with tempfile.TemporaryDirectory() as folder, browser() as tab:
        file = Path(folder) / "run.html"
        file.write_bytes(page)
        tab.open(file.as_uri())
        tab.ask("page.play(true)")
        tab.ask("new Promise((done) => setTimeout(done, 1000))")
        counted = "[page.drawn, performance.now()]"
        first = tab.ask(counted)
        tab.ask(f"new Promise((done) => setTimeout(done, {1000 * seconds}))")
        last = tab.ask(counted)
        drawing = tab.ask(
            "(() => { const begun = performance.now();"
            "for (let k = 0; k < 30; k++) page.map.draw(1 + 0.1 * k, page.chosen);"
            "return (performance.now() - begun) / 30; })()"
        )
    return {
        "mib": len(page) / 2**20,
        "frames": 1000 * (last[0] - first[0]) / (last[1] - first[1]),
        "script_ms": drawing,
    }


def recordings(report: Report) -> None:
    """A table for the run, one for its files, one for the page."""
    rounds = 200 if report.quick else 1_200
    note("a run")
    costs = report.table(
        "LineForm, 16 drones",
        Column("rounds", "rounds", 0),
        Column("recorded_s", "CPU s"),
        Column("recording_s", "of them to record"),
        Column("share", "more by", 3),
        Column("limit", "limit"),
        Column("met", "met"),
    )
    found = in_child(cost, rounds, timeout_s=600.0)
    share = found["recording_s"] / (found["recorded_s"] - found["recording_s"])
    costs.rows.append(
        {"rounds": rounds, **found, "share": share, **limited(share, MOST_SHARE, "of the run")}
    )
    note("files")
    files = report.table(
        f"Its files after {rounds / 10:g} s",
        Column("file", "file"),
        Column("mib", "MiB"),
        Column("cpu_s", "CPU s to make"),
        Column("limit", "limit"),
        Column("met", "met"),
    )
    for name, of in in_child(sizes, rounds, timeout_s=300.0).items():
        mib = of["bytes"] / 2**20
        row = {"file": name, "mib": mib, "cpu_s": of["cpu_s"]}
        files.rows.append(row | limited(mib, MOST_MIB[name], "MiB"))
    many = report.table(
        "MCAP of many robots",
        Column("robots", "robots", 0),
        Column("time_s", "s of simulation", 0),
        Column("mib", "MiB"),
        Column("cpu_s", "CPU s to make"),
        Column("limit", "limit"),
        Column("met", "met"),
    )
    note(f"a file of {MANY} robots")
    found = in_child(of_many, MANY, 6.0 if report.quick else MANY_S, timeout_s=300.0)
    shown = {} if report.quick else limited(found["cpu_s"], MOST_MCAP_S, "CPU s")
    many.rows.append({"robots": MANY, **found, **shown})
    pages = report.table(
        "Its page in a browser, 60 s of robots on circles",
        Column("robots", "robots", 0),
        Column("mib", "MiB"),
        Column("frames", "frames/s", 0),
        Column("script_ms", "ms of script each", 1),
        Column("limit", "limit"),
        Column("met", "met"),
    )
    for robots, wanted in FRAMES.items():
        if report.quick and robots > 100:
            continue
        note(f"frames of {robots} robots")
        shown = in_child(frames, robots, 1.0 if report.quick else 4.0, timeout_s=120.0)
        if not shown:
            note("no browser is installed")
            continue
        slow = limited(1 / shown["frames"], 1 / wanted)
        least = {"limit": f"{wanted:g} frames/s", "met": slow["met"]}
        pages.rows.append({"robots": robots, **shown, **least})


if __name__ == "__main__":
    sys.exit(main("recordings", __doc__, recordings))
