"""Checks of what happens when the other side, the link or the driver's process fails."""

from __future__ import annotations

import time
from collections.abc import Sequence

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.setpoints import Arm, Disarm, Hold
from koord.testing.conformance.bench import Bench, Call, Sample
from koord.testing.conformance.findings import Failed, Measures
from koord.testing.conformance.subjects import flat

#: How long calls may take: nearly all of them, and whatever comes between.
USUALLY_S, AT_MOST_S = 0.010, 0.250

#: The other side is silent for so long, and has so long to be heard again.
_SILENT_S, _BACK_S = 6.0, 15.0


def stale(bench: Bench, found: Measures) -> None:
    """Freeze the other side: poses grow old, or there is no link; and that ends when it goes on."""
    peer = bench.needs_peer()
    bench.linked()
    bench.run(0.5, Disarm())
    peer.freeze()
    bench.is_dead = True
    try:
        samples = bench.run(_SILENT_S, Disarm())
        said = bench.driver.remarks
    finally:
        bench.is_dead = False
        peer.thaw()
    limit_s = bench.subject.limits.pose_age_s
    noticed = [one for one in samples if _is_gone(one, limit_s)]
    if not noticed:
        last = samples[-1]
        raise Failed(
            f"frozen for {_SILENT_S:g} s, its pose is {last.now_s - last.sensed.measured_at_s:.2f}"
            " s old, and there is a link",
            f"older than {limit_s:g} s, or no link",
        )
    found.at_most(noticed[0].now_s - samples[0].now_s, limit_s + 1.0, "noticed after", "s")
    stays = samples[samples.index(noticed[0]) :]
    found.expect(all(_is_gone(one, limit_s) for one in stays), "and for as long as it lasts")
    links = [one for one in samples if not one.sensed.link]
    found.expect(
        bool(links), "no link" if links else "the link is said to be there", "no link in the end"
    )
    bench.kept["remarks"] = said
    again = bench.until(
        lambda s: not _is_gone(s, limit_s) and s.sensed.link, Disarm(), _BACK_S, "it is heard again"
    )
    found.at_most(again[-1].now_s - again[0].now_s, _BACK_S, "heard again after", "s")


def _is_gone(sample: Sample, limit_s: float) -> bool:
    return not sample.sensed.link or sample.now_s - sample.sensed.measured_at_s > limit_s


def link(bench: Bench, found: Measures) -> None:
    """End the other side and start it again: the same driver hears it again, and is obeyed."""
    peer = bench.needs_peer()
    bench.linked()
    bench.run(0.3, Disarm())
    peer.stop()
    bench.is_dead = True
    try:
        lost = bench.run(_SILENT_S, Hold())
    finally:
        peer.start()
        bench.is_dead = False
    found.expect(
        not lost[-1].sensed.link,
        "no link" if not lost[-1].sensed.link else "a link, though nobody is there",
        "no link",
    )
    limit_s = bench.subject.limits.pose_age_s
    back = bench.until(
        lambda s: s.sensed.link and not _is_gone(s, limit_s), Disarm(), _BACK_S, "it is heard again"
    )
    found.at_most(back[-1].now_s - back[0].now_s, _BACK_S, "heard again after", "s")
    if bench.subject.arms:
        bench.until(lambda s: s.sensed.armed is not False, Arm(), 20.0, "armed again")
        found.expect(True, "it is armed again")
        bench.settle()


def remarks(bench: Bench, found: Measures) -> None:
    """Why the vehicle does not answer is said in words."""
    bench.needs_peer()
    if "remarks" not in bench.kept:
        stale(bench, Measures())
    said = bench.kept["remarks"]
    found.expect(bool(said), "; ".join(said) if said else "nothing is said", "why there is no link")


def never_blocks(bench: Bench, found: Measures) -> None:
    """Look at how long each call of the driver took, with the other side there and gone."""
    if len(bench.log) < 40:
        bench.run(2.0, Disarm())
    judge_calls(tuple(bench.calls()), found)


def judge_calls(calls: Sequence[Call], found: Measures) -> None:
    """Judge how long calls took. Raises Failed for those that wait."""
    for words, dead in (("", False), (" while the other side is gone", True)):
        for name in ("sense", "command"):
            took = sorted(one.took_s for one in calls if one.dead is dead and one.name == name)
            if not took:
                continue
            usual, most = took[int(0.95 * (len(took) - 1))], took[-1]
            story = f"`{name}`{words}: 95 % in {1e3 * usual:.1f} ms, at most {1e3 * most:.0f} ms"
            limit = f"{1e3 * USUALLY_S:.0f} ms, {1e3 * AT_MOST_S:.0f} ms"
            found.expect(usual <= USUALLY_S and most <= AT_MOST_S, story, limit)


def second(bench: Bench, found: Measures) -> None:
    """Open a second driver of the same vehicle: it is refused, or disturbs nobody."""
    bench.needs_peer()
    bench.linked()
    bench.run(0.3, Disarm())
    begun_s = time.monotonic()
    try:
        other = bench.subject.driver()
        other.open(bench.clock.now())
    except DriverError as error:
        found.expect(True, f"refused: {error.message}")
    else:
        for _ in range(10):
            other.sense(bench.clock.now())
            bench.tick(Disarm())
        other.close()
        found.expect(True, f"it opens, after {time.monotonic() - begun_s:.1f} s")
    after = bench.run(2.0, Disarm())[-1]
    age_s = after.now_s - after.sensed.measured_at_s
    found.at_most(age_s, bench.subject.limits.pose_age_s, "the first one's pose is old by", "s")
    found.expect(after.sensed.link, "the first one has its link")


def restarts(bench: Bench, found: Measures) -> None:
    """Close and open it twice: what it held is free again, and the vehicle is where it was."""
    before = bench.run(0.3, Disarm())[-1].sensed.position_m
    for _ in range(2):
        took_s = bench.open()
        found.at_most(took_s, bench.subject.opens_within_s, "open again after", "s")
        here = bench.run(0.5, Disarm())[-1].sensed.position_m
        if not bench.subject.is_virtual:
            x, y, _z = flat(here)
            off = ((x - before[0]) ** 2 + (y - before[1]) ** 2) ** 0.5
            found.at_most(off, 0.3, "the vehicle is where it was, but for")
