"""A seeded mistake: a piece of one function replaced by another while its module is imported."""

from __future__ import annotations

import ast
from pathlib import Path

from msgspec import Struct

from tests.mutants.patterns import definitions, replace

ROOT = Path(__file__).parents[2]

#: Names the mutant that the plugin puts in.
VARIABLE = "KOORD_MUTANT"


class Mutant(Struct, frozen=True):
    """In ``place``, ``new`` stands instead of ``old``; ``tests`` are those of which one must fail.

    ``place`` is a function below ``koord``, such as ``recheck.settling.Settling.settle``; where the
    mistake is in no function, a class or a module. ``old`` stands there exactly once: an
    expression, statements one after the other, or the line of a ``case``.
    """

    name: str
    place: str
    old: str
    new: str
    tests: tuple[str, ...]

    @property
    def path(self) -> Path:
        """The file of the function."""
        return self._module_and_definition()[0]

    @property
    def module(self) -> str:
        """The module of the function, as it is imported."""
        return ".".join(self.path.relative_to(ROOT).with_suffix("").parts)

    def tree(self) -> ast.Module:
        """The module with the mistake in it."""
        path, names = self._module_and_definition()
        tree = ast.parse(path.read_text(encoding="utf-8"))
        times = sum(replace(found, self.old, self.new) for found in definitions(tree, names))
        if times != 1:
            raise ValueError(f"{self.name}: {self.old!r} stands {times} times in {self.place}")
        return tree

    def _module_and_definition(self) -> tuple[Path, list[str]]:
        """The longest beginning of the place that is a file, and what is defined in there."""
        names = self.place.split(".")
        for size in range(len(names), 0, -1):
            path = (ROOT / "koord").joinpath(*names[:size]).with_suffix(".py")
            if path.exists():
                return path, names[size:]
        raise ValueError(f"{self.name}: there is no module {self.place}")
