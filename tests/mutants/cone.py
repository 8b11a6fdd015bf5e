"""Mistakes in what a claim depends on. [T-CONE]"""

from __future__ import annotations

from tests.mutants.mutant import Mutant

SLICES = "tests/verify/reduction/test_slices.py"
ASKING = "tests/verify/strategy/test_slices_turn.py"
ENGINES = "tests/agreement/test_slices.py"
LIVE = "tests/agreement/test_live_slices.py"
HAPPENING = "tests/verify/reduction/test_happening.py"
AUXILIARY = "tests/syntax/test_auxiliary.py"

CONE = (
    Mutant(
        "cone: events do not depend on their guards",
        "verify.reduction.influence.Influence._event",
        "self._add(happens, reads)",
        "pass",
        (SLICES,),
    ),
    Mutant(
        "cone: what a loop does does not depend on when it is left",
        "verify.reduction.influence.sites",
        "(*controls, low, high, *_leaving(body))",
        "(*controls, low, high)",
        (SLICES,),
    ),
    Mutant(
        "cone: locks and stops are taken whatever decides about them",
        "verify.reduction.influence.Influence._event",
        "self._add(happens, entered)",
        "pass",
        (SLICES,),
    ),
    Mutant(
        "cone: urgent events oblige nobody to others",
        "verify.reduction.influence.Influence._urgency",
        "self._add(happens, every)",
        "pass",
        (SLICES,),
    ),
    Mutant(
        "cone: contracts restrict nothing",
        "verify.reduction.influence.Influence._module",
        "self.restricted(contract, promise, kind)",
        "()",
        (SLICES,),
    ),
    Mutant(
        "cone: assumptions join nothing",
        "verify.reduction.influence.Influence._assumptions",
        "for part in reads:\n    self._add(part, reads)",
        "for part in ():\n    self._add(part, reads)",
        (SLICES,),
    ),
    Mutant(
        "cone: nothing may fault",
        "verify.reduction.influence.Influence._body",
        "self._add(Matter.FAULT, (*reads, *targets, *by))",
        "pass",
        (SLICES,),
    ),
    Mutant(
        "cone: what only the shared slice breaks is not asked of the whole program",
        "verify.strategy.verification._Verification._of_states",
        "problem.system is self.system and not problem.is_abstract",
        "not problem.is_abstract",
        (ASKING,),
    ),
    Mutant(
        "cone: a slice writes nothing",
        "verify.reduction.slicing._Slicer._matters",
        "bool(self.influence.targets[id(s)] & self.cone)",
        "False",
        (ENGINES,),
    ),
    Mutant(
        "cone: fair runs do not depend on all events",
        "verify.reduction.influence.Influence._fairness",
        "self._add(Matter.WHOLE_RUNS, (Happens(kind, position),))",
        "pass",
        (SLICES,),
    ),
    Mutant(
        "cone: lassos of slices come back to everything",
        "traces.lassos._shape",
        "with_those_of(last, first, spared)",
        "last",
        (LIVE,),
    ),
    Mutant(
        "cone: a variable is auxiliary though branches read it",
        "syntax.analysis.auxiliary._Reading.statement",
        "operands(s)",
        "() if isinstance(s, core.If) else operands(s)",
        (AUXILIARY,),
    ),
    Mutant(
        "cone: a variable is auxiliary though what it flows to is not",
        "syntax.analysis.auxiliary._Reading.depended_on",
        "grows = bool(new)",
        "break",
        (AUXILIARY,),
    ),
    Mutant(
        "cone: a reading is always allowed that is bounded from both sides",
        "syntax.analysis.auxiliary.always_met",
        "len(set(bounds)) <= 1",
        "True",
        (AUXILIARY,),
    ),
    Mutant(
        "cone: a reading is always allowed that is compared with another one",
        "syntax.analysis.auxiliary._bounds",
        "not primed(other)",
        "True",
        (AUXILIARY,),
    ),
    Mutant(
        "cone: what happens is asked without contracts that may end runs",
        "verify.reduction.slicing.Slices._goes_on_without",
        "primed(promise) <= always_met(self.system, kind)",
        "True",
        (HAPPENING,),
    ),
    Mutant(
        "cone: a promise about no reading restricts nothing",
        "syntax.analysis.auxiliary._Reading.promises",
        "not about or not about <= met",
        "not about <= met",
        (AUXILIARY,),
    ),
    Mutant(
        "cone: a lasso that is only one of a slice leaves it at that",
        "verify.strategy.liveness.settled",
        "asking.doubted()",
        "[]",
        (ASKING,),
    ),
)
