"""What compiled programs do with values, where Python would do it otherwise."""

from __future__ import annotations

import pytest

from koord.refinement.cases import SchedulePolicy
from tests.refinement.running import agrees, ran
from tests.sampling import first

NAN = (
    "def Pair:\n  float a\n  float b\n"
    "local:\n  float huge = 1.0\n  float nan = 0.0\n  bool same = true\n  float[] list = []\n"
    "  Pair pair = Pair(0.0, 0.0)\n  int k = 0\n  int n = 1\n"
    "Go:\n  eff:\n"
    "    for k = 0, 12:\n      huge = huge * 1000000000000000000000000000000.0\n"
    "    nan = huge - huge\n    list = [nan, nan]\n    pair = Pair(nan, 1.0)\n    "
)

CASES = {
    "a record that holds NaN is not itself": f"{NAN}same = pair == pair\n",
    "a list that holds NaN is not itself": f"{NAN}same = list == list\n",
    "NaN is in no list": f"{NAN}same = contains(list, nan)\n",
    "NaN is not removed": f"{NAN}remove(list, nan)\n    same = length(list) == 2\n",
    "the least of NaN and a number": f"{NAN}huge = min(nan, 1.0) + max(1.0, nan)\n",
    "a large integer is infinite": (
        "local:\n  int n = 10\n  float x = 0.0\n  float y = 0.0\nGo:\n  pre: n == 10\n"
        "  eff:\n    for k = 0, 9:\n      n = n * n\n    x = 0.5 + n\n    y = 0.5 - (0 - n) * 1\n"
        "    y = 0.5 + (0 - n)\n"
    ),
    "lists are values": (
        "local:\n  int[] a = [1]\n  int[] b = []\n  int[][] c = []\nGo:\n  eff:\n"
        "    b = a\n    append(a, 2)\n    c = [a, b]\n    a[0] = 7\n    c[0][0] = 8\n"
    ),
    "records are values": (
        "def Item:\n  int a = 0\n  int[] b = []\nlocal:\n  Item x = Item()\n  Item y = Item()\n"
        "Go:\n  eff:\n    y = x\n    x.a = x.a + 1\n    append(x.b, 1)\n"
    ),
    "a loop is over what was there before it": (
        "local:\n  int[] a = [1, 2]\n  int n = 0\nGo:\n  eff:\n    for x in a:\n"
        "      append(a, x)\n      n = n + x\n    for k, v in a:\n      n = n + k * v\n"
    ),
    "a loop's bound is taken once": (
        "local:\n  int[] a = [1]\n  int n = 0\nGo:\n  eff:\n    for k = 0, length(a):\n"
        "      append(a, k)\n      n = n + k\n"
    ),
    "the first equal element is removed": (
        "local:\n  int[] a = [1, 2, 1, 1]\nGo:\n  eff:\n    remove(a, 1)\n    remove(a, 5)\n"
    ),
    "removing nothing from a shared list writes nothing": (
        "allwrite:\n  int[] a = [1, 2]\nGo:\n  eff:\n"
        "    if pid == 0: append(a, 3)\n    else: remove(a, 9)\n"
    ),
    "a model that removes nothing keeps what it has written": (
        "using Wall:\n  sensors:\n    int[] gaps = [1, 2]\n  environment:\n    append(gaps, 3)\n"
        "    remove(gaps, 9)\nGo:\n  pre: length(Wall.gaps) > 3\n  eff:\n    stop\n"
    ),
    "a model that removes something reads what was there before": (
        "using Wall:\n  sensors:\n    int[] gaps = [1, 2]\n  environment:\n    append(gaps, 3)\n"
        "    remove(gaps, 1)\nGo:\n  pre: length(Wall.gaps) > 3\n  eff:\n    stop\n"
    ),
    "maps keep their order": (
        "local:\n  Map<int, int> m = {2: 0, 1: 0}\n  int n = 0\nGo:\n  eff:\n    m[3] = 1\n"
        "    m[2] = 5\n    remove(m, 1)\n    m[1] = 4\n"
        "    for k, v in m:\n      n = n * 10 + k + v\n"
    ),
    "integers divide down": (
        "local:\n  int n = -7\n  int a = 0\n  int b = 0\n  float x = 0.0\nGo:\n  eff:\n"
        "    a = n / 2 + n % 2\n    b = n / (0 - 2) + n % (0 - 2)\n    x = n / 2.0 - 0.1 - 0.2\n"
    ),
    "set in one branch only": (
        "local:\n  int a\n  int b = 0\nGo:\n  eff:\n    if pid == 5: a = 1\n    else: b = 1\n"
        "    b = a\n"
    ),
    "set in both branches": (
        "local:\n  int a\n  int b = 0\nGo:\n  eff:\n    if pid == 5: a = 1\n    else: a = 2\n"
        "    b = a\n"
    ),
    "set in a loop that does not happen": (
        "local:\n  int a\n  int b = 0\nGo:\n  eff:\n    for k = 0, pid:\n      a = k\n    b = a\n"
    ),
    "a local of a function that is not set": (
        "local:\n  int b = 0\ndef fun f(int k) -> int:\n  int a\n"
        "  for i = 0, 2:\n    if i < k: a = i\n  return a\nGo:\n  eff:\n    b = f(pid)\n"
    ),
    "a record that is set field by field": (
        "local:\n  pos p\n  pos q\nGo:\n  eff:\n    p.x = 1.0\n    p.y = 2.0\n    p.z = 3.0\n"
        "    q = p\n"
    ),
    "INIT reads others' entries": (
        "allread:\n  int[] x = 1\nlocal:\n  int n = 0\ninit:\n  n = x[pid]\n  n = x[0]\n"
        "Go:\n  eff:\n    n = x[numAgents - 1]\n"
    ),
    "requires with quantifiers": (
        "def fun far(int[] xs, int k) -> int: extern\n"
        "  requires: (forall i in 0, length(xs): xs[i] >= i) and (exists x in xs: x == k)\n"
        "local:\n  int[] xs = [0, 1]\n  int n = 0\nGo:\n  eff:\n    n = far(xs, n + pid)\n"
        "    if n > 3 or n < 0: n = 0\n    append(xs, n)\n"
    ),
    "requires that asks": (
        "def fun near(int k) -> bool: extern\n"
        "def fun far(int k) -> int: extern\n  requires: near(k) or k < 9\n  ensures: result > k\n"
        "local:\n  int n = 0\nGo:\n  eff:\n    for k = 0, 3:\n      n = far(n)\n"
    ),
    "asked anew in every loop": (
        "def fun pick(int k) -> int: extern fresh\n"
        "  ensures: result >= 0 and (k <= 0 or result < k)\n"
        "def fun twice(int k) -> int:\n  int n = 0\n  for i = 0, 2:\n    n = n + pick(k)\n"
        "  return n\n"
        "local:\n  int n = 0\n  int[] xs = [4, 5]\nGo:\n  eff:\n    for i, x in xs:\n"
        "      for k = 0, 2:\n        n = n + pick(x + k) + twice(x)\n    for x in xs:\n"
        "      xs[pick(2)] = pick(9)\n"
    ),
    "roots, distances, middles": (
        "using Motion:\n  sensors:\n    pos psn\n  actuators:\n    pos target\n"
        "local:\n  float d = 0.0\n  pos p = pos(1.0, 2.0, 2.0)\n  pos[] many = []\n"
        "Go:\n  eff:\n    d = distance(p, Motion.psn) + norm(p) + abs(-2.5)\n"
        "    p = midpoint(p, Motion.psn) - p * 0.5 + -p / 3.0\n    append(many, p)\n"
        "    Motion.target = midpoint(many)\n    d = sqrt(d)\n"
    ),
    "neighbours, tasks": (
        "allwrite:\n  Task[2] list\nallread:\n  int[] x = pid\nlocal:\n  int n = 0\n  Task t\n"
        "init:\n  for i = 0, 2:\n    list[i] = Task(loc = pos(0.0, 1.0, 0.0), id = i)\n"
        "Go:\n  pre: not allAssigned(list)\n  eff:\n    atomic:\n"
        "      t = getAvailableNextTask(list)\n      assign(list[t.id], pid)\n"
        "    for k in getNeighbors(pid):\n      n = n + x[k]\n    x[pid] = n\n"
    ),
    "output of every type": (
        "enum Mode: idle, busy\nlocal:\n  Mode m = busy\n  float x = 0.1\n  int[] xs = [1]\n"
        'Go:\n  eff:\n    stdout << "mode " << m << x << xs << true << pos(1.0, 2.0, x)\n'
        "    x = x + x / 3.0\n"
    ),
    "a pre that faults does not oblige": (
        "local:\n  int n = 0\nurgent Odd:\n  pre: 1 / n > 0\n  eff:\n    n = n + 1\n"
        "Even:\n  eff:\n    n = n + 2\n"
    ),
}


@pytest.mark.parametrize("name", first(11, CASES))
def test_values_are_those_of_the_rules(name: str) -> None:
    for policy in SchedulePolicy:
        for seed in range(3):
            agrees(ran(CASES[name], robots=2, rounds=3, policy=policy, seed=seed))
