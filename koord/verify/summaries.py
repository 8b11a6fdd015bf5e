"""Summaries that contradict themselves: external functions without any answer. [EXTERNAL]"""

from __future__ import annotations

from collections.abc import Iterator

from koord.semantics.configurations import System
from koord.semantics.crowds import NotFiniteError
from koord.semantics.expressions import evaluate
from koord.semantics.machine import machine
from koord.semantics.oracle import Phase
from koord.semantics.storage import held
from koord.syntax import core
from koord.syntax.core import UnaryOp
from koord.verify.solving import Answer, Deadline, Effort, Solver
from koord.verify.symbols import SymbolicInputs, Unknowns
from koord.verify.terms import Terms


def unanswerable(
    system: System, seed: int, deadline: Deadline, effort: Effort
) -> Iterator[core.External]:
    """The functions that have no answer for any arguments: whoever calls them never goes on."""
    for external in system.program.externals:
        if external.ensures and not _has_answers(system, external, seed, deadline, effort):
            yield external


def _has_answers(
    system: System, external: core.External, seed: int, deadline: Deadline, effort: Effort
) -> bool:
    """Whether some call, of which the duties are met, has an answer (or nobody knows)."""
    d = Terms()
    unknowns = Unknowns(d, system.program, system.robots)
    inputs = SymbolicInputs(unknowns, "asked")
    m = machine(d, system, inputs.oracle(Phase.PROG, 0), robot=0)
    m.memory.bound = [held(d, unknowns.value(p.name, p.type)) for p in external.parameters]
    reads = tuple(core.Read(core.Place(p)) for p in external.parameters)
    try:
        evaluate(m, core.ExternalCall(external.name, reads, external.result.type, 0))
    except NotFiniteError:
        return True
    solver = Solver(d, unknowns, seed)
    solver.add(needed.condition for needed in m.legality)
    solver.add(d.unary(UnaryOp.NOT, fault) for fault, _ in m.faults)
    # Where only short lists were looked at, a longer one may do.
    return solver.check([], deadline, effort) is not Answer.UNSAT or bool(unknowns.limits)
