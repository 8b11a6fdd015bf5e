"""Seeded mistakes in what is shown and kept of runs."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

GENERATED = "tests/refinement/test_generated.py"
ROUNDS = "tests/refinement/test_rounds.py"
REPLAY = "tests/semantics/test_replay.py"
WITNESS = "tests/verify/test_witness.py"

SHOWN = (
    Mutant(
        "an event that faults has effects",
        "semantics/rounds.py",
        "        return Stepped(replace(configuration, fault=found), _shown(d, turned))\n",
        "        configuration = replace(configuration, fault=found)\n",
        (GENERATED,),
    ),
    Mutant(
        "ports are told of a turn of the environment that faults",
        "semantics/rounds.py",
        "        return Stepped(replace(configuration, fault=found))\n",
        "        return Stepped(\n"
        "            replace(configuration, robots=tuple(robots), fault=found)\n"
        "        )\n",
        (GENERATED,),
    ),
    Mutant(
        "a start that faults is shown",
        "semantics/rounds.py",
        "    if fault is None:\n        return stepped\n",
        "    if fault is None or stepped:\n        return stepped\n",
        (GENERATED,),
    ),
    Mutant(
        "output behind a fault is written",
        "semantics/statements.py",
        "            if not m.faulted:\n",
        "            if types:\n",
        (GENERATED,),
    ),
    Mutant(
        "robots move behind a fault in what is kept of it",
        "verify/witness.py",
        "        recording, phase = until(recording, last), _phase_of(last)\n",
        "        phase = _phase_of(last)\n",
        (WITNESS,),
    ),
    Mutant(
        "a map that is read again in another order stays as it was",
        "runtime/robot.py",
        "if name in self._ordered or value != held[name]:",
        "if value != held[name]:",
        (ROUNDS, GENERATED),
    ),
    Mutant(
        "an argument that is no number is another one each time",
        "semantics/execution.py",
        "if not all(map(identical, answer.arguments, arguments)):",
        "if answer.arguments != arguments:",
        (REPLAY,),
    ),
    Mutant(
        "an answer that is no number is another one each time",
        "semantics/execution.py",
        "if not identical(known.setdefault(question, answer.value), answer.value):",
        "if known.setdefault(question, answer.value) != answer.value:",
        (REPLAY,),
    ),
)
