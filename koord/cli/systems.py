"""The robots that a command asks for, as a system."""

from __future__ import annotations

from argparse import ArgumentTypeError
from fractions import Fraction

from koord.cli.arguments import Fleet
from koord.semantics.configurations import System, dealt
from koord.syntax import core
from koord.syntax.costs import excesses
from koord.syntax.diagnostics import KoordError


def system_of(program: core.Program, fleet: Fleet, delta_s: Fraction) -> System:
    """The program with its robots.

    Raises ArgumentTypeError for kinds it does not have, and KoordError where it is too much for so
    many robots.
    """
    system = _robots(program, fleet, delta_s)
    found = excesses(program, system.kinds)
    if found:
        raise KoordError(found)
    return system


def _robots(program: core.Program, fleet: Fleet, delta_s: Fraction) -> System:
    if not fleet.kinds:
        least = len(program.agents) if fleet.any_number else 1
        return dealt(program, max(fleet.total, least), delta_s)
    names = [agent.name for agent in program.agents]
    kinds: list[int] = []
    for name, count in fleet.kinds:
        if name not in names:
            known = ", ".join(names) if names != [""] else "only one kind, which has no name"
            raise ArgumentTypeError(f"--robots: there is no agent {name} here; there is {known}")
        kinds += [names.index(name)] * count
    return System(program, tuple(kinds), delta_s)
