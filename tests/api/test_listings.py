"""Programs with the constructs of published listings: accepted, brought over, verified, run."""

from __future__ import annotations

import math

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

#: A ShapeForm that turns: corners fly to the corners of a square that turns, the others between.
SQUARE = """\
param int numAgents = 9
param float half = 4.0  # half the side of the square
param float height = 2.0
param float step = 0.01  # radians an update
param int updates = 300  # then the square stays as it is

def fun side() -> int:
    for k = 0, numAgents + 1:
        if k * k == numAgents:
            return k
    return 0

def fun cell(int me, float angle) -> pos:
    float gap = 2 * half / (side() - 1)
    float a = me / side() * gap - half
    float b = me % side() * gap - half
    return pos(a * cos(angle) - b * sin(angle), a * sin(angle) + b * cos(angle), height)

def fun aim(int me, pos[] x, float angle) -> pos:
    int w = side()
    bool top = me / w == 0 or me / w == w - 1
    bool flank = me % w == 0 or me % w == w - 1
    if top and flank:
        return cell(me, angle)
    if top:
        return midpoint(x[me - 1], x[me + 1])
    if flank:
        return midpoint(x[me - w], x[me + w])
    return midpoint([x[me - 1], x[me + 1], x[me - w], x[me + w]])

def fun atRest(pos[] x, float angle) -> bool:
    for i = 0, numAgents:
        if x[i] != aim(i, x, angle):
            return false
    return true

def fun fenced(pos p) -> bool:
    return abs(p.x) <= 2 * half and abs(p.y) <= 2 * half and p.z == height

def fun between(float v, float a, float b) -> bool:
    return min(a, b) <= v and v <= max(a, b)

using Motion:
    sensors:
        pos psn
    actuators:
        pos target
    contract Direct:
        ensures:
            between(psn'.x, psn.x, target.x)
            between(psn'.y, psn.y, target.y)
            between(psn'.z, psn.z, target.z)

allread:
    pos[] x

local:
    float angle = 0.0
    int turned = 0

init:
    x[pid] = Motion.psn
    Motion.target = Motion.psn

Turn:
    eff:
        if turned < updates:
            angle = angle + step
            turned = turned + 1
        x[pid] = Motion.psn
        Motion.target = aim(pid, x, angle)

assume: side() > 1 and fenced(Motion.psn)

invariant Fence: fenced(Motion.psn)
invariant Heard: forall i: fenced(x[i])
invariant Aim: fenced(Motion.target)
invariant Turned: forall i: angle@i == step * turned@i
invariant Square: forall k: atRest(x, angle@k) implies forall i: x[i] == cell(i, angle@k)
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


@pytest.mark.parametrize("name", LISTINGS)
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


@pytest.mark.parametrize("robots", [4, pytest.param(9, marks=pytest.mark.slow)])
def test_a_square_turns_as_the_rules_allow(robots: int) -> None:
    """Compiled, and simulated until it stands on the turned grid."""
    program = Source("square.krd", SQUARE.replace("numAgents = 9", f"numAgents = {robots}"))
    assert koord.refine(program, runs=3, rounds=4).ok
    side = math.isqrt(robots)
    places = (
        f"{k}: [{8 * (k // side) / (side - 1) - 4}, {8 * (k % side) / (side - 1) - 4}, 2]"
        for k in range(robots)
    )
    drone = "{bot_name: drone, bot_type: QUAD, planner: STRAIGHT, simulation: {level: fast}}"
    text = f"num_robots: {robots}\ndevice: {drone}\npositions: {{{', '.join(places)}}}\n"
    text += "world: {bounds: {low: [-9, -9, 0], high: [9, 9, 4]}}\n"
    done = koord.simulate(
        program, koord.read_configuration(Source("run.yaml", text)), duration_s=40
    )
    assert done.ok
    angle = 3.0  # 300 updates of 0.01
    x, y = -4 * math.cos(angle) + 4 * math.sin(angle), -4 * math.sin(angle) - 4 * math.cos(angle)
    first = done.recording.poses[-1][0, :2].tolist()
    assert first == [pytest.approx(x, abs=0.3), pytest.approx(y, abs=0.3)]


@pytest.mark.slow
@pytest.mark.parametrize("robots", [4, 9])
def test_what_is_claimed_of_a_turning_square_holds_in_every_round(robots: int) -> None:
    program = Source("square.krd", SQUARE.replace("numAgents = 9", f"numAgents = {robots}"))
    report = koord.verify(program, timeout_s=280)
    assert {one.name for one in report.verdicts if one.holds} >= {
        "Fence",
        "Heard",
        "Aim",
        "Turned",
        "Square",
    }, report
