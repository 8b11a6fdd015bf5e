"""The page of the library, from the prelude and from the functions that are built in."""

from __future__ import annotations

import re

from docs.generator.markdown import fence
from koord.syntax.elaboration.library import library_text

PAGE = "reference/library.md"

_SECTION = re.compile(r"^# --- (.*?) -+$")
_DECLARED = re.compile(r"^(?:def fun|def|using) (\w+)")


def pages() -> dict[str, str]:
    """The page."""
    return {PAGE: _page(library_text())}


def names(text: str) -> list[str]:
    """What the prelude declares, in order; a name once."""
    found = (_DECLARED.match(line) for line in text.split("\n"))
    return list(dict.fromkeys(match[1] for match in found if match))


def _page(source_text: str) -> str:
    text = (
        "# Library\n\nGenerated from the prelude, which every program may use without declaring "
        "it. Functions with a body are ordinary Koord. Of the others a program and a proof know "
        "what the summary says (`requires:`, `ensures:`). `extern` answers alike for equal "
        "arguments; `extern fresh` may answer anew at each call. Where a name is declared more "
        "than once, the arguments choose. Functions whose types depend on their arguments "
        "(`length`, `append`, `min`, …) are part of the [language](language.md#calls).\n"
    )
    listed: set[str] = set()
    for title, entries in _sections(source_text):
        text += f"\n## {title[:1].upper()}{title[1:]}\n"
        for name, comment, source in entries:
            if name not in listed:
                text += f"\n### {name}\n"
                listed.add(name)
            if comment:
                text += f"\n{comment}\n"
            text += "\n" + fence("koord", source)
    return text


def _sections(text: str) -> list[tuple[str, list[tuple[str, str, str]]]]:
    """The sections of the prelude: name, comment before it, and text of each declaration."""
    found: list[tuple[str, list[tuple[str, str, str]]]] = []
    comment: list[str] = []
    lines = text.split("\n")
    at = 0
    while at < len(lines):
        line = lines[at]
        at += 1
        if section := _SECTION.match(line):
            found.append((section[1], []))
            comment = []
        elif line.startswith("#"):
            comment.append(line.removeprefix("#").strip())
        elif declared := _DECLARED.match(line):
            block = [line]
            while at < len(lines) and (not lines[at] or lines[at].startswith(" ")):
                block.append(lines[at])
                at += 1
            found[-1][1].append((declared[1], " ".join(comment), "\n".join(block)))
            comment = []
        elif not line:
            comment = []
    return found
