"""Mistakes in machine code of doubles, and of the vehicles that it moves."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

DRONES = "tests/sim/test_compiled_quadrotors.py"

LANES = (
    Mutant(
        "a bound takes the place of what is no number",
        "machine.lanes.Lane._chosen",
        "self.lanes.code.b.fcmp_ordered(relation, end.ir, self.ir)",
        "self.lanes.code.b.fcmp_unordered(relation, end.ir, self.ir)",
        (DRONES,),
    ),
    Mutant(
        "the last drones of a fleet fly as the last of all",
        "sim.vehicles.compiled.flight",
        "b.select(b.icmp_signed('<', lane, last), lane, last)",
        "last",
        (DRONES,),
    ),
    Mutant(
        "the last drones of a fleet do not fly",
        "sim.vehicles.compiled.flight",
        "b.icmp_signed('!=', rest, word(0))",
        "b.icmp_signed('<', rest, word(0))",
        (DRONES,),
    ),
    Mutant(
        "a state that somebody has set is not flown from",
        "sim.vehicles.compiled.CompiledQuadrotors._is_known",
        "bool(known) and all(map(is_, _parts(self.state), known))",
        "bool(known)",
        (DRONES,),
    ),
    Mutant(
        "constants of other steps are flown with",
        "sim.vehicles.compiled.CompiledQuadrotors.advance",
        "self._steps != (dt_s, steps)",
        "self._steps is None",
        (DRONES,),
    ),
    Mutant(
        "what stands on the ground has two zeros",
        "sim.vehicles.compiled._Step.moved",
        "vz.at_least(0.0) + 0.0",
        "vz.at_least(0.0)",
        (DRONES,),
    ),
    Mutant(
        "machine code divides by multiplying",
        "sim.vehicles.compiled._Step.turned",
        "(w / size, x / size, y / size, z / size)",
        "(w * (1.0 / size), x * (1.0 / size), y * (1.0 / size), z * (1.0 / size))",
        (DRONES,),
    ),
    Mutant(
        "flying changes what drones are told",
        "sim.vehicles.quadrotors.Quadrotors.advance",
        "reference.position.T.copy()",
        "np.ascontiguousarray(reference.position.T)",
        (DRONES,),
    ),
)
