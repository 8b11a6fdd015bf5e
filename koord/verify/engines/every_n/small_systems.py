"""Snapshots of what small systems of a program reach: samples for the look for lemmas."""

from __future__ import annotations

from msgspec import Struct
from msgspec.structs import replace

from koord.sampling.compiled.turns import Turns
from koord.sampling.reached import reached
from koord.semantics.configurations import Configuration
from koord.semantics.domain import EXACT, Constant
from koord.syntax import core
from koord.syntax.budget import Budget, OutOfBudgetError, Ration
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System, resized
from koord.verify.engines.every_n.conditions import asked_of
from koord.verify.engines.every_n.language import Language
from koord.verify.engines.every_n.literals import Snapshot

#: Sampled systems: how many robots, and how many turns are spent on them.
_SAMPLED = ((2, 800), (3, 2_400))

#: And where conditions may ask how many robots there are of a sort: of three it is soon all.
_COUNTED = (*_SAMPLED, (4, 1_600))

#: So many starts are sampled where a program leaves them open, each with fewer turns; and so many
#: where samples are few: to find one can take longer than the runs from it.
_STARTS, _FEW_STARTS = 8, 2

#: Where so many of them met no assumptions, those that did will do.
_MOST_IN_VAIN = 3

#: So many steps of work a sampled system may cost: what is slow is sampled less.
_SAMPLING = 100_000


class Sample(Struct, frozen=True):
    """A configuration that a small system reached, and what lemmas may say of it."""

    system: System
    configuration: Configuration[Constant]
    snapshot: Snapshot


def sampled(system: System, language: Language, seed: int, part: int = 1) -> list[Sample]:
    """Look at configurations that two robots reach, and three, and four where it matters.

    There are only so many turns as one in ``part`` of the usual ones.
    """
    asked = asked_of(language.conditions, language.size)
    found = list[Sample]()
    for count, turns in _COUNTED if language.conditions or language.ring else _SAMPLED:
        few = replace(resized(system, count), budget=system.budget.rationed(_SAMPLING))
        try:
            starts = _STARTS if part == 1 else _FEW_STARTS
            for here in _reached(few, system.budget, turns // part, seed, starts):
                if here.fault is None:
                    found.append(Sample(few, here, language.sampled(here, asked(few, here))))
        except (KoordError, OutOfBudgetError):
            continue  # What was looked at by then is a sample too.
    return found


def _reached(
    few: System, budget: Budget, turns: int, seed: int, starts: int
) -> list[Configuration[Constant]]:
    """Configurations of a small system; each of so many starts has a part of the budget's steps.

    Where assumptions are hard to meet most starts are in vain: a few that are met soon will do.
    """
    if not _is_open(few.program):
        starts = 1
    found, in_vain = list[Configuration[Constant]](), 0
    ration = Ration(budget, 0)
    rationed = replace(few, budget=ration.budget())
    code = Turns(EXACT, rationed)
    for k in range(starts):
        ration.left = _SAMPLING // starts
        more = reached(rationed, turns // starts, seed + k, hasty=starts > 1, code=code)
        found, in_vain = found + more, in_vain + (not more)
        if found and in_vain >= _MOST_IN_VAIN:
            break
    if not found and starts > 1:
        found = reached(few, turns // starts, seed)
    return found


def _is_open(program: core.Program) -> bool:
    """Return whether a program says nothing of what some variable begins with."""
    return any(d.initial is core.Start.ARBITRARY for d in (*program.allread, *program.allwrite))
