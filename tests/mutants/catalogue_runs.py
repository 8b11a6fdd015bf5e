"""Mistakes in the code of runs: of claims, of turns, and of what they ask."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

AGREEMENT = "tests/agreement/test_compiled_runs.py"

RUNS = (
    Mutant(
        "the code of claims does not hear of changes",
        "sampling.compiled.columns.Columns.show",
        "watcher.note(column, index)",
        "watcher.is_stale",
        (AGREEMENT,),
    ),
    Mutant(
        "the code of claims forgets one of two readers",
        "sampling.compiled.claims._Splitting._part",
        "known | {position[name]}",
        "frozenset({position[name]})",
        (AGREEMENT,),
    ),
    Mutant(
        "what did not hold is settled",
        "sampling.compiled.claims.Part.holds",
        "if not self._instances_hold(): return False",
        "if not self._instances_hold(): watcher.settle(); return False",
        (AGREEMENT,),
    ),
    Mutant(
        "a claim is looked at for one of its robots alone",
        "sampling.compiled.claims.Part._instances_hold",
        "self.watcher.everything or sum(map(len, touched)) > len(self.kinds[0])",
        "False",
        (AGREEMENT,),
    ),
    Mutant(
        "floats that are no whole numbers of a unit are cut off",
        "sampling.compiled.operations.scaled",
        "if rest: raise InDoubt",
        "if rest and not unit: raise InDoubt",
        (AGREEMENT,),
    ),
    Mutant(
        "code goes on with numbers of any length",
        "sampling.compiled.operations.handy",
        "number.bit_length() > domain.LONGEST_NUMBER_BITS",
        "number.bit_length() > 100 * domain.LONGEST_NUMBER_BITS",
        (AGREEMENT,),
    ),
    Mutant(
        "code counts from the end of a list",
        "sampling.compiled.operations.pick",
        "0 <= index < len(items)",
        "-len(items) <= index < len(items)",
        (AGREEMENT,),
    ),
    Mutant(
        "code divides by zero as if nothing were wrong",
        "sampling.compiled.operations.quotient",
        "if not right: raise InDoubt",
        "if not right: return left - left",
        (AGREEMENT,),
    ),
    Mutant(
        "code takes what is unset for set",
        "sampling.compiled.operations.held",
        "cell.value if cell.is_set is True else UNSET",
        "cell.value",
        (AGREEMENT,),
    ),
    Mutant(
        "code removes the last equal item",
        "sampling.compiled.operations.removed",
        "enumerate(parts)",
        "reversed(list(enumerate(parts)))",
        (AGREEMENT,),
    ),
    Mutant(
        "code asks under one key in all trips",
        "sampling.compiled.statements.BodyWriter.external",
        "tuple_text(self.trail)",
        "tuple_text([])",
        (AGREEMENT,),
    ),
    Mutant(
        "code takes any answer of a function",
        "sampling.compiled.asking.Asking.external",
        "if m.faults or m.legality: raise InDoubt",
        "if m.legality: raise InDoubt",
        (AGREEMENT,),
    ),
    Mutant(
        "code enters a lock class twice",
        "sampling.compiled.turns.Turns.run_event",
        "if entered & configuration.taken: return None",
        "if entered - entered: return None",
        (AGREEMENT,),
    ),
    Mutant(
        "code keeps what a robot ran in the last round",
        "sampling.compiled.turns._opened",
        "if state.turn is Turn.ENV: return robots",
        "return robots",
        (AGREEMENT,),
    ),
    Mutant(
        "code stops nobody when all asked to stop",
        "sampling.compiled.turns._ended",
        "state.status != Status.RUNNING",
        "state.status == Status.STOPPED",
        (AGREEMENT,),
    ),
    Mutant(
        "code commits no write of a whole variable",
        "sampling.compiled.turns.TurnWriter.write",
        "self.line(f'{masks}[{variable.slot}] = WHOLE')",
        "self.line('pass')",
        (AGREEMENT,),
    ),
    Mutant(
        "models of code read what they wrote",
        "sampling.compiled.turns.TurnWriter.read",
        "self._name(variable, after=place.primed)",
        "self._name(variable, after=place.primed or self.in_environment)",
        (AGREEMENT,),
    ),
    Mutant(
        "code hears of no broken contract of a model",
        "sampling.compiled.turns._look_at",
        "' and '.join(writer.expression(e) for e in contract.ensures) or 'True'",
        "'True'",
        (AGREEMENT,),
    ),
)
