"""Rules of specifications: those that a text states, and those that files cite."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]


class Rules:
    """The rules of ``specs/NAME/README.md``, by the patterns that state and cite them.

    ``but`` is the name of the file that does not count: that of the test.
    """

    def __init__(
        self, name: str, stated: tuple[re.Pattern[str], ...], cited: re.Pattern[str], but: str
    ) -> None:
        self.text = (ROOT / "specs" / name / "README.md").read_text(encoding="utf-8")
        self.stated = tuple(rule for pattern in stated for rule in pattern.findall(self.text))
        self.mentioned = frozenset(cited.findall(self.text))
        self._cited, self._but = cited, but

    def cited(self, *folders: str) -> frozenset[str]:
        """The rules that Python files in folders cite."""
        return _cited(self._cited, self._but, folders)


@cache
def _cited(pattern: re.Pattern[str], but: str, folders: tuple[str, ...]) -> frozenset[str]:
    files = (path for folder in folders for path in (ROOT / folder).rglob("*.py"))
    texts = (path.read_text(encoding="utf-8") for path in files if path.name != but)
    return frozenset(rule for text in texts for rule in pattern.findall(text))
