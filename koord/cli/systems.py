"""The robots that a command asks for, as a system."""

from __future__ import annotations

from argparse import ArgumentTypeError
from collections.abc import Sequence
from fractions import Fraction

from koord.cli.arguments import Fleet
from koord.semantics.configurations import System, dealt
from koord.syntax import core
from koord.syntax.costs import excesses
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import whole_file


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
            known = f"there are {', '.join(names)}"
            if names == [""]:
                known = "there is only one kind, which has no name"
            raise ArgumentTypeError(f"--robots: there is no agent {name} here; {known}")
        kinds += [names.index(name)] * count
    return System(program, tuple(kinds), delta_s)


def kinds_by_role(
    program: core.Program, roles: Sequence[str | None], file: str
) -> tuple[tuple[int, ...], tuple[Diagnostic, ...]]:
    """Of which kind each robot is: as a configuration says, or dealt round; and what is wrong."""
    names = [agent.name for agent in program.agents]
    if all(role is None for role in roles):
        return dealt(program, len(roles)).kinds, ()
    known = ", ".join(str(name) for name in names)
    problems = tuple(
        Diagnostic(
            "K932",
            Severity.ERROR,
            whole_file(file),
            f"robot {pid} is of kind {role}, which the program does not have",
            f"its kinds are {known}",
        )
        for pid, role in enumerate(roles)
        if role not in names
    )
    return tuple(names.index(role) if role in names else 0 for role in roles), problems
