"""Programs and configurations together: the robots of one as those of the other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.diagnostics import Diagnostic, Severity
from koord.syntax.source import whole_file
from koord.syntax.system import System, dealt

if TYPE_CHECKING:
    from koord.runtime.configuration.model import Configuration


def suited(
    configuration: Configuration, program: core.Program, delta_s: Fraction | None
) -> Configuration:
    """The configuration with δ: as the flag says, or it does itself, or the program states it."""
    if delta_s is not None:
        return replace(configuration, delta_s=float(delta_s))
    if configuration.delta_s is None:
        return replace(configuration, delta_s=float(program.instance.used_delta_s))
    return configuration


def unlike(
    configuration: Configuration, program: core.Program, kinds: Sequence[int] | None
) -> tuple[Diagnostic, ...]:
    """Warnings where a configuration is another instance than the program is meant for. It wins.

    ``kinds`` are those of its robots, or None where a flag says how many there are.
    """
    meant, found = program.instance, []
    if meant.kinds and kinds is not None and Counter(meant.kinds) != Counter(kinds):
        here = System(program, tuple(kinds)).fleet
        found.append((("agents",), System(program, meant.kinds).fleet, f"here are {here}"))
    delta_s = configuration.delta_s
    if meant.delta_s is not None and delta_s is not None and float(meant.delta_s) != delta_s:
        found.append((("delta",), f"δ = {float(meant.delta_s):g} s", f"it is {delta_s:g} s here"))
    return tuple(
        Diagnostic(
            "K936",
            Severity.WARNING,
            configuration.place(*path),
            f"the program is meant for {wanted}; {other}",
            "what was verified for the one need not hold of the other",
        )
        for path, wanted, other in found
    )


def kinds_by_role(
    program: core.Program, roles: Sequence[str | None], file: str
) -> tuple[tuple[int, ...], tuple[Diagnostic, ...]]:
    """Of which kind each robot is: as a configuration says, or dealt round; and what is wrong."""
    names = [agent.name for agent in program.agents]
    if all(role is None for role in roles):
        return dealt(program, len(roles)).kinds, ()
    cure = f"its kinds are {', '.join(names)}"
    if names == [""]:
        cure = "its robots are of one kind, which has no name: leave `kind` out"
    problems = tuple(
        Diagnostic(
            "K932",
            Severity.ERROR,
            whole_file(file),
            f"robot {pid} is of kind {role}, which the program does not have",
            cure,
        )
        for pid, role in enumerate(roles)
        if role not in names
    )
    return tuple(names.index(role) if role in names else 0 for role in roles), problems
