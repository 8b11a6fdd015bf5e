"""Seeded mistakes in plug-ins of a lab's own, and in what drivers are tested by."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

PLUG_INS = "tests/runtime/platform/test_plug_ins.py"
KIT = "tests/testing/test_conformance.py"

_KIT = "testing.conformance"

#: What would let a robot go on with what it must not, or a driver pass that must not.
PLUGGED = (
    Mutant(
        "paths of a lab's planner may lead through obstacles",
        "runtime.plugins.planning.CheckedPlanner._checked",
        "self._ground.field(avoid).path_free(path, body.inner_radius_m)",
        "True",
        (PLUG_INS,),
    ),
    Mutant(
        "a robot goes on while a plug-in fails",
        "runtime.platform.vehicle.DrivenVehicle._wish",
        "is_running and not self.pilot.troubles",
        "is_running",
        (PLUG_INS,),
    ),
    Mutant(
        "who blocks is waited for each time",
        "runtime.plugins.calls.Guarded.call",
        "self._since_s is not None",
        "False",
        (PLUG_INS,),
    ),
    Mutant(
        "one call that waits for long is overlooked",
        f"{_KIT}.failing.judge_calls",
        "usual <= USUALLY_S and most <= AT_MOST_S",
        "usual <= USUALLY_S",
        (KIT,),
    ),
    Mutant(
        "a vehicle may leave its fence",
        f"{_KIT}.safety.fence",
        "outside <= 0",
        "True",
        (KIT,),
    ),
    Mutant(
        "checks of a process that died are forgotten",
        f"{_KIT}.beside.Running.missing",
        "check not in self.found",
        "False",
        ("tests/testing/test_beside.py",),
    ),
)
