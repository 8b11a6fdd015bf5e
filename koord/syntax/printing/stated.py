"""Statements as texts: sections with properties, each printable by itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Generic, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import ast
from koord.syntax.printing.program import print_program

S = TypeVar("S", bound=ast.Section)


class Stated(Struct, Generic[S], frozen=True):
    """A section that states something; ``agent`` is the kind of robot in whose block it stands."""

    section: S
    agent: ast.Ident | None = None

    @property
    def whole(self) -> ast.Section:
        """The section with the block around it that it needs to mean the same."""
        if self.agent is None:
            return self.section
        return ast.Agent(self.agent, (self.section,), span=self.section.span)

    @property
    def text(self) -> str:
        """It in Koord."""
        whole = self.whole
        return print_program(ast.Program((whole,), (), span=whole.span)).rstrip("\n")


def stated(sections: Sequence[ast.Section], kind: type[S]) -> tuple[Stated[S], ...]:
    """The sections of one kind in the order of the core program: those outside of blocks first."""
    outside: list[Stated[S]] = [Stated(s) for s in sections if isinstance(s, kind)]
    inside: list[Stated[S]] = [
        Stated(section, block.name)
        for block in sections
        if isinstance(block, ast.Agent)
        for section in block.sections
        if isinstance(section, kind)
    ]
    return (*outside, *inside)


def with_invariants(
    sections: Sequence[ast.Section], invariants: Sequence[tuple[str, Stated[ast.Invariant]]]
) -> tuple[ast.Section, ...]:
    """The sections with other invariants, of such names, in place of what they claim."""
    named = [
        (replace(s.section, name=ast.Ident(name, span=s.section.span)), s.agent)
        for name, s in invariants
    ]

    def those(block: str | None) -> Iterator[ast.Section]:
        return (made for made, agent in named if (agent.name if agent else None) == block)

    def kept(of: Sequence[ast.Section], block: str | None) -> tuple[ast.Section, ...]:
        return (*(s for s in of if not isinstance(s, _CLAIMED)), *those(block))

    return tuple(
        replace(s, sections=kept(s.sections, s.name.name)) if isinstance(s, ast.Agent) else s
        for s in kept(sections, None)
    )


_CLAIMED = (ast.Invariant, ast.Eventually, ast.LeadsTo)
