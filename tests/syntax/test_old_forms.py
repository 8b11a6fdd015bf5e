"""Old forms mean what today's do, and their edits make today's of them. [OLD-FORM]"""

from __future__ import annotations

from textwrap import dedent

import pytest

from koord.syntax.diagnostics import Diagnostic, Edit, Severity
from koord.syntax.edits import edited
from koord.syntax.elaboration import Elaborated
from koord.syntax.load import load
from koord.syntax.printing.program import format_source
from koord.syntax.source import Source, Span
from tests.syntax.elaborating import diagnostics, errors, only


def loaded(text: str) -> Elaborated:
    return load(Source("old.krd", text))


def old(text: str) -> list[Diagnostic]:
    return [d for d in loaded(text).diagnostics if d.code == "K407"]


#: Old texts, and what stands in their place today. Comments and layout stay. [OLD-FORM]
FORMS = {
    # [OLD-COLON]
    "guard without a colon": (
        "local:\n  int n = 0\nE:\n  pre n < 3   # few\n  eff: n = n + 1\n",
        "local:\n  int n = 0\nE:\n  pre: n < 3   # few\n  eff: n = n + 1\n",
    ),
    "guard as a statement": (
        "local:\n  int n = 0\nE:\n  pre (n < 3);   # few\n  eff: n = n + 1\n",
        "local:\n  int n = 0\nE:\n  pre: (n < 3)   # few\n  eff: n = n + 1\n",
    ),
    "semicolon behind a guard": (
        "local:\n  int n = 0\nE:\n  pre: n < 3;\n  eff: n = n + 1\n",
        "local:\n  int n = 0\nE:\n  pre: n < 3\n  eff: n = n + 1\n",
    ),
    "heads without colons": (
        "using M  # mine\n  sensors\n    int level\n  actuators\n    int lamp\n"
        "local\n  int n = 0\ninit\n  n = 1\nE\n  pre: n > 0\n  eff\n"
        "    n = M.level\n    M.lamp = n\n",
        "using M:  # mine\n  sensors:\n    int level\n  actuators:\n    int lamp\n"
        "local:\n  int n = 0\ninit:\n  n = 1\nE:\n  pre: n > 0\n  eff:\n"
        "    n = M.level\n    M.lamp = n\n",
    ),
    "kinds and records without colons": (
        "def Load\n  int mass\nagent Crane\n  local: Load held = Load(3)\n"
        "  Drop:\n    eff: held.mass = 0\n",
        "def Load:\n  int mass\nagent Crane:\n  local: Load held = Load(3)\n"
        "  Drop:\n    eff: held.mass = 0\n",
    ),
    "bodies behind their heads": (
        "local int n = 0\nE:\n  eff n = n + 1\n",
        "local: int n = 0\nE:\n  eff: n = n + 1\n",
    ),
    # [OLD-NAME]
    "number of robots": (
        "local:\n  int n = numBots\nE:\n  pre: n < numBots  # numBots\n  eff: n = numBots - 1\n",
        "local:\n  int n = numAgents\nE:\n  pre: n < numAgents  # numBots\n"
        "  eff: n = numAgents - 1\n",
    ),
    "size of an array": (
        "allwrite:\n  int[numBots] n\nE:\n  eff: n[pid] = 1\n",
        "allwrite:\n  int[numAgents] n\nE:\n  eff: n[pid] = 1\n",
    ),
    "positions": (
        "using Motion:\n  sensors: ItemPosition position\nlocal:\n  ItemPosition[] seen = []\n"
        "E:\n  eff: append(seen, Motion.position)\n",
        "using Motion:\n  sensors: pos position\nlocal:\n  pos[] seen = []\n"
        "E:\n  eff: append(seen, Motion.position)\n",
    ),
    "maps, scans and planners": (
        "using MotionWithScan:\n  sensors:\n    PathPlanner planner\n    List<Point, Scan> pscan\n"
        "allread:\n  GridMap known = {}\nlocal:\n  Grid[] parts = []\n  Scan last = []\n"
        'E:\n  pre: planner != ""\n  eff:\n    last = pscan\n'
        "    known[pid] = merge(known[0], scanToMap(last))\n    append(parts, known[pid])\n",
        "using MotionWithScan:\n  sensors:\n    string planner\n    pos[] pscan\n"
        "allread:\n  Map<int, bool>[] known = {}\n"
        "local:\n  Map<int, bool>[] parts = []\n  pos[] last = []\n"
        'E:\n  pre: planner != ""\n  eff:\n    last = pscan\n'
        "    known[pid] = merge(known[0], scanToMap(last))\n    append(parts, known[pid])\n",
    ),
    # [OLD-PLANNER]
    "the planner of a module": (
        "using Motion\nlocal:\n  pos[] way = []\n  pos[] walls = []\n"
        "E:\n  eff:\n    way = Motion.planner((1, 2, 3))\n"
        "    way = Motion . planner( Motion.psn, walls)  # around\n"
        "    Motion.path = planner(way[0])\n",
        "using Motion\nlocal:\n  pos[] way = []\n  pos[] walls = []\n"
        "E:\n  eff:\n    way = findPath(Motion.psn, pos(1, 2, 3))\n"
        "    way = findPath(Motion.psn, Motion.psn, walls)  # around\n"
        "    Motion.path = findPath(Motion.psn, way[0])\n",
    ),
    "the planner of a module with ports of its own": (
        "using Drive:\n  sensors:\n    pos psn\n  actuators:\n    pos[] path\n"
        "E:\n  eff: Drive.path = Drive.planner(Drive.psn)\n",
        "using Drive:\n  sensors:\n    pos psn\n  actuators:\n    pos[] path\n"
        "E:\n  eff: Drive.path = findPath(Drive.psn, Drive.psn)\n",
    ),
    # [OLD-ALLREAD]
    "one value of each robot": (
        "allread:\n  bool up = false\n  Map<int, bool> known = {}\n"
        "E:\n  pre: not up[0]\n  eff:\n    up[pid] = true\n    known[pid] = {}\n",
        "allread:\n  bool[] up = false\n  Map<int, bool>[] known = {}\n"
        "E:\n  pre: not up[0]\n  eff:\n    up[pid] = true\n    known[pid] = {}\n",
    ),
    # [OLD-POSITION]
    "positions without their name": (
        "local:\n  pos high = (0.0, 1, 2.5)\n  pos[] way = []\n"
        "E:\n  pre: high.z > 0\n  eff: way = [(1, 2, 3), high + (0, 0, (1))]\n",
        "local:\n  pos high = pos(0.0, 1, 2.5)\n  pos[] way = []\n"
        "E:\n  pre: high.z > 0\n  eff: way = [pos(1, 2, 3), high + pos(0, 0, (1))]\n",
    ),
    # [OLD-ELEMENT]
    "elements of lists and maps": (
        "local:\n  int[] x = [1, 2]\n  Map<int, bool> m = {}\n  bool b = false\n"
        "E:\n  pre: get(x, 0) > get(x, (1))\n  eff:\n"
        "    put(x, get(x, 0) - 1, (2) * get( x , 1 ))  # the first\n"
        "    b = get(m, x[0])\n    put(m, (x[1]), b)\n",
        "local:\n  int[] x = [1, 2]\n  Map<int, bool> m = {}\n  bool b = false\n"
        "E:\n  pre: x[0] > x[(1)]\n  eff:\n"
        "    x[x[0] - 1] = (2) * x[1]  # the first\n"
        "    b = m[x[0]]\n    m[(x[1])] = b\n",
    ),
    # [OLD-NEIGHBOURS]
    "positions of neighbours": (
        "using Motion:\n  sensors: pos psn\n  actuators: pos target\n"
        "allread:\n  ItemPosition x\nE:\n  eff:\n    x[pid] = psn\n"
        "    Motion.target = midpoint(getNeighbors(pid))\n"
        "    Motion.target = mid(getNeighbors( pid ))\n",
        "using Motion:\n  sensors: pos psn\n  actuators: pos target\n"
        "allread:\n  pos[] x\nE:\n  eff:\n    x[pid] = psn\n"
        "    Motion.target = midpoint(getNeighbors(pid, x))\n"
        "    Motion.target = mid(getNeighbors( pid , x))\n",
    ),
}


@pytest.mark.parametrize(("was", "now"), FORMS.values(), ids=FORMS)
def test_edits_make_todays_form(was: str, now: str) -> None:
    edits = [edit for found in old(was) for edit in found.edits]
    assert edited(Source("old.krd", was), edits) == now


@pytest.mark.parametrize(("was", "now"), FORMS.values(), ids=FORMS)
def test_both_forms_mean_the_same(was: str, now: str) -> None:
    before, after = loaded(was), loaded(now)
    assert [d for d in before.diagnostics if d.severity is Severity.ERROR] == []
    assert old(was)
    assert old(now) == []
    assert before.program is not None
    assert before.program == after.program


@pytest.mark.parametrize(("was", "now"), FORMS.values(), ids=FORMS)
def test_each_warning_names_its_cure(was: str, now: str) -> None:
    for found in old(was):
        assert found.edits
        assert found.hint is not None


def test_a_name_is_told_once_with_all_its_edits() -> None:
    (found,) = old(FORMS["number of robots"][0])
    assert found.message.endswith("it stands in lines 4, 5 as well")
    assert [edit.span.line for edit in found.edits] == [2, 4, 5]


def test_an_edit_is_made_once_where_events_are_of_several_kinds() -> None:
    text = "E:\n  pre: pid < numBots\n  eff: stop\n"
    text += "agent A:\n  local: int a\nagent B:\n  local: int b\n"
    (found,) = old(text)
    assert len(found.edits) == 1
    assert "as well" not in found.message


def test_own_names_are_no_old_ones() -> None:
    assert old("def ItemPosition:\n  int shelf\nlocal:\n  ItemPosition p = ItemPosition(3)\n") == []
    text = "def fun get(int[] x, int i) -> int:\n  return i\nlocal:\n  int n = get([1], 0)\n"
    assert old(text) == []
    assert old("param int numBots = 2\nE:\n  pre: pid < numBots\n  eff: stop\n") == []


@pytest.mark.parametrize("call", ["get(x)", "get(x, 0, 0)", "get(x,\n     0)"])
def test_other_calls_of_get_are_functions_that_nobody_declares(call: str) -> None:
    text = f"local:\n  int[] x = [1]\n  int n = 0\nE:\n  eff: n = {call}\n"
    assert old(text) == []
    assert errors(text) == ["K202"]


def test_statements_need_their_colons() -> None:
    assert errors("E:\n  eff:\n    if pid == 0\n      stop\n") == ["K114"]
    assert errors("E:\n  eff:\n    atomic stop\n") == ["K114"]


def test_semicolons_end_nothing_else() -> None:
    assert errors("local:\n  int n = 0\nE:\n  eff: n = 1;\n") == ["K133"]
    assert "K133" in errors("local:\n  int n = 0\nE:\n  pre: n > 0; stop\n  eff: stop\n")


def test_positions_of_which_variable_has_to_be_known() -> None:
    text = """
        using Motion:
          sensors: pos psn
        allread:
          pos[] x
          pos[] y
        local: pos near
        E:
          eff:
            x[pid] = psn
            y[pid] = psn
            near = midpoint(getNeighbors(pid))
    """
    found = only(text)
    assert found.code == "K210"
    assert found.hint == "write `getNeighbors(…, x)`"
    assert errors(
        text.replace("          pos[] x\n          pos[] y\n", "          int[] x\n")
        .replace("x[pid] = psn", "x[pid] = 1")
        .replace("y[pid] = psn", "pass")
    ) == ["K204"]


def test_numbers_of_neighbours_are_what_they_were() -> None:
    text = "allread:\n  pos[] x\nlocal:\n  int[] near = []\nE:\n  eff: near = getNeighbors(pid)\n"
    assert [d.code for d in diagnostics(dedent(text))] == ["K403"]


def test_programs_with_old_forms_are_laid_out_in_todays() -> None:
    was, _ = FORMS["guard as a statement"]
    formatted = format_source(Source("old.krd", was))
    assert formatted.diagnostics == ()
    assert "    pre: n < 3  # few\n" in formatted.text


def test_of_edits_that_overlap_one_is_made() -> None:
    def edit(first: int, last: int, text: str) -> Edit:
        return Edit(Span("t", 1, first, 1, last), text)

    assert (
        edited(Source("t", "abcdef\n"), [edit(2, 4, "X"), edit(3, 5, "Y"), edit(4, 4, "Z")])
        == "aXZdef\n"
    )
    assert edited(Source("t", "ab"), []) == "ab"
