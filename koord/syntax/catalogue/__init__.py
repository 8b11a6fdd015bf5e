"""The catalogue of diagnostics, printed by ``koord explain``.

One Markdown file a code, as ``K204.md``: a heading with its severity and title, the story, and, if
a program's text alone yields the code, a program that does and one that does not. Codes K9xx are
of files, traces and runs: they have no example.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files

from msgspec import Struct

from koord.syntax.diagnostics import Severity

_FORM = re.compile(
    r"# (?P<severity>error|warning) (?P<code>K\d{3}): (?P<title>[^\n]+)\n"
    r"\n(?P<story>.+?\n)"
    r"(\n## This is (refused|warned of)\n\n```koord\n(?P<bad>.+)```\n"
    r"\n## This is right\n\n```koord\n(?P<good>.+)```\n)?",
    re.DOTALL,
)


class Story(Struct, frozen=True):
    """The story of a code: ``bad`` is a program that yields it, ``good`` one that does not."""

    code: str
    title: str
    severity: Severity
    story: str  #: in paragraphs, with an empty line between two
    bad: str = ""
    good: str = ""

    @classmethod
    def read(cls, text: str) -> Story:
        """Parse a file of the catalogue. Raises ValueError if it has another form."""
        parts = _FORM.fullmatch(text)
        if parts is None:
            raise ValueError(f"no entry of the catalogue: {text.partition(chr(10))[0]}")
        return cls(
            code=parts["code"],
            title=parts["title"],
            severity=Severity(parts["severity"]),
            story=parts["story"],
            bad=parts["bad"] or "",
            good=parts["good"] or "",
        )


@cache
def entries() -> Mapping[str, Story]:
    """Every code that koord can print, in order, with its story."""
    pages = (each for each in files(__name__).iterdir() if each.name.endswith(".md"))
    read = (Story.read(page.read_text(encoding="utf-8")) for page in pages)
    return {entry.code: entry for entry in sorted(read, key=lambda entry: entry.code)}


def of_programs() -> Mapping[str, Story]:
    """The codes that the text of a program yields by itself: they have examples."""
    return {code: entry for code, entry in entries().items() if entry.bad}
