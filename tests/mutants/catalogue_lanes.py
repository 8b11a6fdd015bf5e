"""Mistakes in machine code of doubles, and of the vehicles that it moves."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

DRONES = "tests/sim/test_compiled_quadrotors.py"
FLYING = "tests/sim/test_compiled_flying.py"
MEASURING = "tests/sim/test_compiled_measuring.py"

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
    Mutant(
        "orders wait for the machine code of automata",
        "sim.vehicles.compiled_flying.CompiledFlying.step",
        "group.is_told()",
        "False",
        (FLYING,),
    ),
    Mutant(
        "arrays of before are read",
        "sim.vehicles.compiled_flying.CompiledFlying._point_to",
        "known is not array",
        "known is None",
        (FLYING,),
    ),
    Mutant(
        "who is near its end has been there for long",
        "sim.vehicles.compiled_flying._Drone.step_automaton",
        "b.and_(inside, dwelt)",
        "inside",
        (FLYING,),
    ),
    Mutant(
        "who has been pushed away stays away",
        "sim.vehicles.compiled_flying._Drone.step_automaton",
        "distance.is_at_most(of['leave_m'])",
        "has_route",
        (FLYING,),
    ),
    Mutant(
        "references do not wait for drones",
        "sim.vehicles.compiled_flying._Drone.command",
        "faster * (2.0 - 2.0 * lag / LAG_M).greater(0.0).lesser(1.0)",
        "faster",
        (FLYING,),
    ),
    Mutant(
        "who holds goes on in machine code",
        "sim.vehicles.compiled_flying._Drone.command",
        "self.either(on, faster, slower)",
        "faster",
        (FLYING,),
    ),
    Mutant(
        "references go on behind the end",
        "sim.vehicles.compiled_flying._Drone.command",
        "(s + wanted * of['dt_s']).lesser(length)",
        "s + wanted * of['dt_s']",
        (FLYING,),
    ),
    Mutant(
        "of pairs that are equally near the last is named",
        "sim.gauge_kernel._nearer",
        "b.fcmp_unordered('<', square.ir, least)",
        "b.fcmp_unordered('<=', square.ir, least)",
        (MEASURING,),
    ),
    Mutant(
        "what comes after no number is nearer",
        "sim.gauge_kernel._nearer",
        "is_less = b.and_(is_less, b.fcmp_ordered('ord', least, least))",
        "pass",
        (MEASURING,),
    ),
    Mutant(
        "squares are added up in another order",
        "sim.gauge_kernel._Places.square",
        "x * x + y * y + z * z",
        "x * x + (y * y + z * z)",
        (MEASURING,),
    ),
    Mutant(
        "who was near is nearest for ever",
        "sim.gauge_kernel.CompiledGoing.tick",
        "not self._listed.is_sure(math.sqrt(square), math.sqrt(moved2))",
        "False",
        (MEASURING,),
    ),
    Mutant(
        "ways are gone twice where pairs are listed anew",
        "sim.gauge_kernel.CompiledGoing.tick",
        "self._measured(here_at, 0, count)",
        "self._measured(here_at, self._ways_at, count)",
        (MEASURING,),
    ),
)
