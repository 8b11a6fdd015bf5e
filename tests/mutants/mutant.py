"""A seeded mistake: one piece of source text replaced by another while it is imported."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]

#: Names the mutant that the plugin puts in.
VARIABLE = "KOORD_MUTANT"


@dataclass(frozen=True, slots=True)
class Mutant:
    """``old`` stands exactly once in the file; ``tests`` are those of which one must fail."""

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]

    @property
    def path(self) -> Path:
        return ROOT / "koord" / self.file

    @property
    def module(self) -> str:
        return "koord." + self.file.removesuffix(".py").replace("/", ".")

    def source(self) -> str:
        """The text with the mistake in it."""
        text = self.path.read_text(encoding="utf-8")
        if text.count(self.old) != 1:
            raise ValueError(f"{self.name}: {self.old!r} stands {text.count(self.old)} times")
        return text.replace(self.old, self.new)
