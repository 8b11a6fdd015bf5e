"""Mistakes in what a claim depends on. [T-CONE]"""

from __future__ import annotations

from tests.mutants.mutant import Mutant

SLICES = "tests/verify/cone/test_slices.py"
ASKING = "tests/verify/cone/test_asking.py"
ENGINES = "tests/agreement/test_slices.py"
LIVE = "tests/agreement/test_live_slices.py"
AUXILIARY = "tests/semantics/test_auxiliary.py"
INFLUENCE = "verify/cone/influence.py"

CONE = (
    Mutant(
        "cone: events do not depend on their guards",
        INFLUENCE,
        "        self._add(happens, reads)\n",
        "",
        (SLICES,),
    ),
    Mutant(
        "cone: what a loop does does not depend on when it is left",
        INFLUENCE,
        "inner = (*controls, low, high, *_leaving(body))",
        "inner = (*controls, low, high)",
        (SLICES,),
    ),
    Mutant(
        "cone: locks and stops are taken whatever decides about them",
        INFLUENCE,
        "            self._add(happens, entered)\n",
        "            pass\n",
        (SLICES,),
    ),
    Mutant(
        "cone: urgent events oblige nobody to others",
        INFLUENCE,
        "                self._add(happens, every)\n",
        "                pass\n",
        (SLICES,),
    ),
    Mutant(
        "cone: contracts restrict nothing",
        INFLUENCE,
        "                for part in self.restricted(contract, promise, kind):\n",
        "                for part in ():\n",
        (SLICES,),
    ),
    Mutant(
        "cone: assumptions join nothing",
        INFLUENCE,
        "            for part in reads:\n                self._add(part, reads)",
        "            for part in ():\n                self._add(part, reads)",
        (SLICES,),
    ),
    Mutant(
        "cone: nothing may fault",
        INFLUENCE,
        "                self._add(Matter.FAULT, (*reads, *targets, *by))\n",
        "                pass\n",
        (SLICES,),
    ),
    Mutant(
        "cone: what only the shared slice breaks is not asked of the whole program",
        "verify/portfolio.py",
        "        is_whole = part is system and not subject.is_abstract\n",
        "        is_whole = not subject.is_abstract\n",
        (ASKING,),
    ),
    Mutant(
        "cone: a slice writes nothing",
        "verify/cone/slicing.py",
        "bool(self.influence.targets[id(s)] & self.cone)",
        "False",
        (ENGINES,),
    ),
    Mutant(
        "cone: fair runs do not depend on all events",
        INFLUENCE,
        "                self._add(Matter.WHOLE_RUNS, (Happens(kind, position),))\n",
        "                pass\n",
        (SLICES,),
    ),
    Mutant(
        "cone: lassos of slices come back to everything",
        "semantics/lassos.py",
        "        back = with_those_of(last, first, spared)\n",
        "        back = last\n",
        (LIVE,),
    ),
    Mutant(
        "cone: a variable is auxiliary though branches read it",
        "semantics/auxiliary.py",
        "                self.use(condition, kind)\n",
        "                pass\n",
        (AUXILIARY,),
    ),
    Mutant(
        "cone: a variable is auxiliary though what it flows to is not",
        "semantics/auxiliary.py",
        "            grows = bool(new)\n",
        "            break\n",
        (AUXILIARY,),
    ),
    Mutant(
        "cone: a lasso that is only one of a slice leaves it at that",
        "verify/live/settling.py",
        "            if doubted := asking.doubted():\n",
        "            if doubted := []:\n",
        (ASKING,),
    ),
)
