"""Programs with the constructs of published listings: accepted, brought over, verified, run."""

from __future__ import annotations

import pytest

import koord
from koord.syntax.source import Source

#: Robots in a line go to the middle between their neighbours.
LINE = """\
using Motion:
  sensors: ItemPosition position
  actuators: ItemPosition target

allread:
  ItemPosition place

init:
  place[pid] = Motion.position

Follow:
  pre (True);
  eff:
    place[pid] = Motion.position
    if pid != 0 and pid != numBots - 1:
      Motion.target = mid([place[pid + 1], place[pid - 1]])

invariant Own: forall i: i >= 0 and i < numBots
"""

#: Robots carry parcels, by tasks of their own and the planner of their module. [TASK]
PARCELS = """\
def Task:
  pos loc
  int assignId = -1

using Motion
  actuators:
    pos[] route
  sensors:
    pos psn
    boolean done
    PathPlanner planner

allwrite:
  Task[3] parcels

local:
  int mine = -1
  pos[] way = []

assume: forall k in 0, 3: parcels[k].assignId == -1

Pick:
  pre mine == -1 and not allAssigned(parcels)
  eff:
    atomic:
      for k = 0, 3:
        if mine == -1 and parcels[k].assignId == -1:
          way = Motion.planner(parcels[k].loc)
          if way != []:
            assign(parcels[k], pid)
            mine = k
    if mine != -1:
      Motion.route = way

Drop:
  pre mine != -1 and Motion.done
  eff: mine = -1

invariant Taken: allAssigned(parcels) == (forall k in 0, 3: parcels[k].assignId >= 0)
invariant Mine: forall i: mine@i == -1 or parcels[mine@i].assignId == i
invariant Apart: forall i, j: i != j and mine@i != -1 implies mine@i != mine@j
"""

#: Robots map what they see, and go where the known part ends, around what stands there.
MAPPING = """\
using MotionWithScan:
  sensors:
    Point psn
    List<Point, Scan> pscan
    PathPlanner planner
    bool reached
  actuators:
    List<Point> path

allwrite:
  GridMap known = {}

local:
  Grid seen = {}
  pos goal = (0.0, 0.0, 0.0)
  List<Point> way = []

Look:
  pre: MotionWithScan.reached
  eff:
    seen = merge(seen, scanToMap(pscan))
    goal = pickFrontierPos(seen, psn)
    way = MotionWithScan.planner(goal, \\
        findObs(seen))
    if way != []:
      MotionWithScan.path = way
    atomic:
      known = merge(known, seen)

invariant Goal: forall i: length(way@i) > 0 implies way@i[length(way@i) - 1] == goal@i
"""

#: Robots stand on a circle, each at an angle of its own, and turn on with it.
CIRCLE = """\
using Motion:
  sensors:
    pos psn
    float yaw
  actuators:
    pos target

local:
  float angle = 0.0
  bool aligned = false

init:
  angle = 2 * pi * pid / numAgents

Turn:
  pre: angle < 100 * pi
  eff:
    angle = angle + 0.25
    aligned = -0.1 < yaw - atan2(psn.y, psn.x) and yaw - atan2(psn.y, psn.x) < 0.1
    Motion.target = (3 * cos(angle), 3 * sin(angle), 1.0)

invariant Inside: forall i: ran(Turn)@i implies
  -3 <= Motion.target.x@i and Motion.target.x@i <= 3 and Motion.target.y@i <= 3
"""

LISTINGS = {"line": LINE, "parcels": PARCELS, "mapping": MAPPING, "circle": CIRCLE}


@pytest.mark.parametrize("name", LISTINGS)
def test_it_means_the_same_when_it_is_brought_over(name: str) -> None:
    source = Source(f"{name}.krd", LISTINGS[name])
    found = koord.migrate(source)
    assert found.errors == ()
    assert found.steps
    assert koord.load(source).core == koord.load(found.migrated).core
    assert koord.check(found.migrated).warnings == ()
    assert not koord.migrate(found.migrated).changed


@pytest.mark.parametrize(
    "name", sorted(LISTINGS.keys() - {"mapping"})
)  # maps of any size take long
def test_its_properties_hold(name: str) -> None:
    source = koord.migrate(Source(f"{name}.krd", LISTINGS[name])).migrated
    report = koord.verify(source, robots=3, rounds=3, timeout_s=60)
    verdicts = {verdict.name: verdict for verdict in report.verdicts}
    stated = [property_.name for property_ in koord.load(source).core.properties]
    assert stated
    assert all(verdicts[each].holds for each in stated), report


@pytest.mark.parametrize("name", LISTINGS)
def test_compiled_it_does_what_the_rules_allow(name: str) -> None:
    found = koord.refine(Source(f"{name}.krd", LISTINGS[name]), runs=3, rounds=4)
    assert found.ok
