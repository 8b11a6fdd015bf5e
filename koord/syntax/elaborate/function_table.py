"""The functions that a program can call: its own, and those of the library."""

from __future__ import annotations

from msgspec import Struct, field

from koord.syntax import ast, core
from koord.syntax.source import Span
from koord.syntax.types import Type


class Signature(Struct):
    """A function as its callers see it. A type that is None is wrong, which was told."""

    name: str  #: in the core program, where names are unique
    written: str
    parameters: tuple[Type | None, ...]
    parameter_names: tuple[str, ...]
    result: Type | None
    sound: bool
    definition: ast.FunDef
    library: bool

    @property
    def external(self) -> bool:
        """Whether it is known by its summary only."""
        return isinstance(self.definition.body, ast.External)


class FunctionTable(Struct):
    """Signatures by written name, and which of them are wanted in the core program.

    A function of the library is elaborated when it is first called; ``pending`` holds those that
    still have to be.
    """

    own: dict[str, Signature] = field(default_factory=dict)
    library: dict[str, tuple[Signature, ...]] = field(default_factory=dict)
    definitions: dict[str, tuple[ast.FunDef, ...]] = field(default_factory=dict)
    pending: list[Signature] = field(default_factory=list)
    wanted: set[str] = field(default_factory=set)
    #: For each function, those that it calls.
    calls: dict[str, list[str]] = field(default_factory=dict)
    elaborated: dict[str, core.Function | core.External] = field(default_factory=dict)

    #: Where the program first asked for a function of the library.
    origins: dict[str, Span] = field(default_factory=dict)

    def want(self, signature: Signature, origin: Span) -> None:
        """Note that the core program calls the function; ``origin`` is where it asks for it."""
        if signature.name not in self.wanted:
            self.wanted.add(signature.name)
            self.origins[signature.name] = origin
            self.pending.append(signature)
