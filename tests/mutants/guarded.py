"""Seeded mistakes in the guardian, and in what proves and explores it."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

MODES = "tests/runtime/guardian/test_modes.py"
CONDITIONS = "tests/runtime/guardian/test_conditions.py"
EXPLORATION = "tests/runtime/guardian/test_exploration.py"
WALKS = "tests/runtime/guardian/test_walks.py"
VEHICLES = "tests/runtime/guardian/test_vehicles.py"
PROOF = "tests/refinement/test_guardian_proof.py"
CONFIGURATION = "tests/runtime/test_configuration.py"

_MODES = "runtime.guardian.modes"
_JUDGED = "runtime.guardian.conditions"

#: What keeps a robot from moving when it may not, and what brings it down.
GUARDED = (
    Mutant(
        "who is disarmed hears no e-stop",
        f"{_MODES}.after_order",
        "case Order.ESTOP, _:",
        "case Order.ESTOP, Mode.ARMED | Mode.RUNNING | Mode.HOLDING | Mode.LANDING | Mode.STOPPED:",
        (PROOF, EXPLORATION),
    ),
    Mutant(
        "an e-stop can be reset in the air",
        f"{_MODES}.after_order",
        "case Order.RESET, Mode.ESTOPPED | Mode.STOPPED if state.at_rest:",
        "case Order.RESET, Mode.ESTOPPED | Mode.STOPPED:",
        (MODES,),
    ),
    Mutant(
        "who moves can be armed",
        f"{_MODES}.after_order",
        "case Order.ARM, Mode.DISARMED | Mode.STOPPED if state.at_rest:",
        "case Order.ARM, Mode.DISARMED | Mode.STOPPED:",
        (MODES,),
    ),
    Mutant(
        "an e-stop is over when people say arm",
        f"{_MODES}.after_order",
        "case Order.ARM, Mode.DISARMED | Mode.STOPPED if state.at_rest:",
        "case Order.ARM, Mode.DISARMED | Mode.STOPPED | Mode.ESTOPPED if state.at_rest:",
        (PROOF, EXPLORATION),
    ),
    Mutant(
        "start does not ask whether all is well",
        f"{_MODES}.after_order",
        "is_clear(limits, state, state.now_s)",
        "state.now_s >= limits.resume_s",
        (PROOF, EXPLORATION),
    ),
    Mutant(
        "stop is forgotten",
        f"{_MODES}.after_order",
        "replace(_hold(limits, state), waits=True)",
        "_hold(limits, state)",
        (PROOF, EXPLORATION),
    ),
    Mutant(
        "start does not end what people were waited for",
        f"{_MODES}.after_order",
        "replace(state, waits=False, pose=None)",
        "replace(state, pose=None)",
        (MODES,),
    ),
    Mutant(
        "each hold has its own T",
        f"{_MODES}._hold",
        "held_since_s is None or state.now_s - state.since_s >= limits.resume_s",
        "True",
        (PROOF, EXPLORATION),
    ),
    Mutant(
        "the first hold counts for ever",
        f"{_MODES}._hold",
        "held_since_s is None or state.now_s - state.since_s >= limits.resume_s",
        "held_since_s is None",
        (PROOF, EXPLORATION, MODES),
    ),
    Mutant(
        "who leaves the fence goes on by itself",
        f"{_MODES}.after_tick",
        "case Mode.HOLDING if facts.outside:",
        "case Mode.HOLDING if facts.outside and state.waits:",
        (PROOF, EXPLORATION),
    ),
    Mutant(
        "a condition is waited for a while",
        f"{_MODES}.after_tick",
        "state.mode is Mode.RUNNING and facts.tripped",
        "state.mode is Mode.RUNNING and facts.tripped and now_s - state.since_s >= limits.resume_s",
        (PROOF, EXPLORATION),
    ),
    Mutant(
        "who holds is asked for T only when it could go on",
        f"{_MODES}.after_tick",
        "now_s - (state.held_since_s or 0.0) >= limits.hold_s",
        "not facts.tripped and now_s - (state.held_since_s or 0.0) >= limits.hold_s",
        (PROOF, EXPLORATION),
    ),
    Mutant(
        "who holds may hold for a moment longer than T",
        f"{_MODES}.after_tick",
        "now_s - (state.held_since_s or 0.0) >= limits.hold_s",
        "now_s - (state.held_since_s or 0.0) > limits.hold_s",
        (PROOF, EXPLORATION),
    ),
    Mutant(
        "a bad tick does not count if the last one was good",
        f"{_MODES}.after_tick",
        "None if facts.tripped else clear_since_s",
        "None if facts.tripped and state.clear_since_s is None else clear_since_s",
        (PROOF, EXPLORATION),
    ),
    Mutant(
        "an empty battery is waited with",
        f"{_MODES}.after_tick",
        "case Mode.RUNNING | Mode.HOLDING if facts.critical:",
        "case Mode.RUNNING if facts.critical:",
        (PROOF, EXPLORATION),
    ),
    Mutant(
        "a drone that is started again in the air is disarmed",
        f"{_MODES}.setpoint",
        "Disarm() if state.at_rest else _down(limits)",
        "Disarm() if state.at_rest or state.mode is Mode.DISARMED else _down(limits)",
        (PROOF, EXPLORATION, MODES),
    ),
    Mutant(
        "an e-stop drops drones that are to land",
        f"{_MODES}.setpoint",
        "limits.estop is EstopAction.DISARM or state.at_rest",
        "True",
        (PROOF, EXPLORATION),
    ),
    Mutant(
        "a mode begins when the last one began",
        f"{_MODES}._enter",
        "replace(state, mode=mode, since_s=state.now_s, held_since_s=held_since_s, waits=False)",
        "replace(state, mode=mode, held_since_s=held_since_s, waits=False)",
        (PROOF, EXPLORATION),
    ),
    Mutant(
        "time runs backwards",
        f"{_MODES}.after_tick",
        "max(state.now_s, now_s)",
        "now_s",
        (PROOF, EXPLORATION, MODES),
    ),
    Mutant(
        "an e-stop that changes nothing is not answered",
        "runtime.guardian.machine._order",
        "replace(after, now_s=state.now_s) == state and order is not Order.ESTOP",
        "replace(after, now_s=state.now_s) == state",
        (PROOF, EXPLORATION, MODES),
    ),
    Mutant(
        "conditions are told at every tick",
        "runtime.guardian.machine._of_conditions",
        "condition in after.conditions and condition not in before.conditions",
        "condition in after.conditions",
        (MODES, WALKS),
    ),
    # what is judged
    Mutant(
        "what comes from the future is young",
        f"{_JUDGED}._is_young",
        "abs(age_s) <= most_s",
        "age_s <= most_s",
        (CONDITIONS,),
    ),
    Mutant(
        "an age that is no number is young",
        f"{_JUDGED}._is_young",
        "age_s is not None and abs(age_s) <= most_s",
        "age_s is not None and not abs(age_s) > most_s",
        (CONDITIONS,),
    ),
    Mutant(
        "a battery of 87 is full",
        f"{_JUDGED}._battery",
        "least <= battery <= _FULL",
        "least <= battery",
        (CONDITIONS,),
    ),
    Mutant(
        "a battery that was low is well at once",
        f"{_JUDGED}._battery",
        "least += limits.battery_more",
        "pass",
        (CONDITIONS,),
    ),
    Mutant(
        "a pose that jumps is believed at the next tick",
        f"{_JUDGED}.judged",
        "stories[Condition.JUMP] = jump",
        "stories[Condition.JUMP] = jump\n"
        "trusted = TrustedPose(sensed.position_m, sensed.measured_at_s)",
        (CONDITIONS,),
    ),
    Mutant(
        "a robot may have got anywhere while its pose was missing",
        f"{_JUDGED}._jump",
        "min(elapsed_s, limits.pose_age_s)",
        "elapsed_s",
        (CONDITIONS,),
    ),
    Mutant(
        "a drone whose link is lost may be at rest",
        f"{_JUDGED}._at_rest",
        "sensed.link and not sensed.airborne",
        "not sensed.airborne",
        (CONDITIONS,),
    ),
    Mutant(
        "what is known of velocity does not count",
        f"{_JUDGED}._of_place",
        "[_braking(limits, sensed.velocity_mps)]",
        "[(0.0, 0.0, 0.0)]",
        (CONDITIONS,),
    ),
    Mutant(
        "a robot stops at once",
        f"{_JUDGED}._stopping_m",
        "speed_mps * limits.reaction_s + speed_mps * speed_mps / (2 * limits.braking_mps2)",
        "speed_mps * limits.reaction_s",
        (CONDITIONS,),
    ),
    Mutant(
        "motion may arm and disarm",
        f"{_JUDGED}._unsafe",
        'return f"motion wishes for {type(wish).__name__}, which is for people alone"',
        "return None",
        (CONDITIONS,),
    ),
    Mutant(
        "motion may wish for any speed",
        f"{_JUDGED}._unsafe",
        "not speed_mps <= limits.speed_mps",
        "speed_mps != speed_mps",
        (CONDITIONS,),
    ),
    Mutant(
        "motion may aim at what is outside of the fence",
        f"{_JUDGED}._unsafe",
        "target is not here and not setup.field.clearance(*target) >= limits.margin_m",
        "target is None",
        (CONDITIONS,),
    ),
    Mutant(
        "other robots are where they were",
        f"{_JUDGED}._close",
        "place + np.array(other.velocity_mps) * moved_s + _braking(limits, other.velocity_mps)",
        "place",
        (CONDITIONS,),
    ),
    Mutant(
        "who moves away from another robot is too close",
        f"{_JUDGED}._close",
        "nearest_m >= least_m or nearest_m >= resting_m - _NEARER_M",
        "nearest_m >= least_m",
        (CONDITIONS,),
    ),
    Mutant(
        "other robots need no way to brake",
        f"{_JUDGED}._close",
        "place + np.array(other.velocity_mps) * moved_s + _braking(limits, other.velocity_mps)",
        "place + np.array(other.velocity_mps) * moved_s",
        (CONDITIONS,),
    ),
    Mutant(
        "other robots do what they did when they were seen",
        f"{_JUDGED}._close",
        "limits.braking_mps2 * (moved_s + limits.reaction_s) ** 2",
        "0.0",
        (CONDITIONS, VEHICLES),
    ),
    # how it is proved and configured
    Mutant(
        "one answer to each question is tried",
        "refinement.guardian_proof.symbolic.Symbols.decided",
        "self._forks.append(self._asked)",
        "pass",
        (PROOF,),
    ),
    Mutant(
        "the second answer is given to the wrong question",
        "refinement.guardian_proof.symbolic.Symbols.ways",
        "self._solver.pop(self._asserted - last)",
        "self._solver.pop(self._asserted - last - 1)",
        (PROOF,),
    ),
    Mutant(
        "limits of all robots count before those of a device",
        "runtime.configuration.checking._Checker._safety",
        'stated_safety(body, (form.safety, ("safety",)), own)',
        'stated_safety(body, own, (form.safety, ("safety",)))',
        (CONFIGURATION,),
    ),
)
