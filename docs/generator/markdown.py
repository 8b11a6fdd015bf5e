"""Pieces of Markdown: tables, text that is shown as it is, anchors, links."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

_FENCE = re.compile(r"^ *(```+|~~~+)")
_HEADING = re.compile(r"^(#{1,6}) +(.*?)(?: +\{ *#([\w-]+) *\})? *$")

#: A link or an image: what is shown, where it leads, and the anchor there.
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\[\]]*\])*)\]\(([^()\s#]*)(#[^()\s]*)?\)")

_SHOWN = re.compile(r"(`+)(?:(?!`).)*\1", re.DOTALL)


def plain(text: str) -> str:
    """A text that is shown as it is, on one line, outside of what stands between backquotes."""
    flat = " ".join(text.split())
    parts = re.split(r"(`[^`]*`)", flat)
    for i in range(0, len(parts), 2):
        parts[i] = re.sub(r"([\\*_<>\[\]{}|])", r"\\\1", parts[i])
    return "".join(parts)


def code(text: str) -> str:
    """A text as code, in a line."""
    return f"`{text}`" if "`" not in text else f"`` {text} ``"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of cells that are Markdown already."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(map(_cell, line)) + " |\n" for line in lines)


def _cell(text: str) -> str:
    flat = " ".join(text.split())
    return re.sub(r"(?<!\\)\|", r"\\|", flat)


def fence(language: str, text: str) -> str:
    """A block of code."""
    return f"```{language}\n{text.rstrip()}\n```\n"


def slug(heading: str) -> str:
    """The anchor of a heading, as mkdocs.yml and GitHub make it."""
    shown = LINK.sub(lambda match: match[2], heading)
    shown = re.sub(r"[`*]|\\(?=[\W_])", "", shown)
    return re.sub(r"[^\w\- ]", "", shown.lower().strip()).replace(" ", "-")


def prose(markdown: str) -> Iterator[tuple[int, str]]:
    """The lines that stand in no block of code, with their indices."""
    closing = ""
    for i, line in enumerate(markdown.split("\n")):
        found = _FENCE.match(line)
        if closing:
            if found and found[1].startswith(closing):
                closing = ""
        elif found:
            closing = found[1]
        else:
            yield i, line


def anchors(markdown: str) -> set[str]:
    """Every anchor of a page."""
    made: set[str] = set()
    for _, line in prose(markdown):
        heading = _HEADING.match(line)
        if heading is None:
            continue
        wanted = heading[3] or slug(heading[2])
        name, count = wanted, 0
        while name in made:
            count += 1
            name = f"{wanted}_{count}"
        made.add(name)
    return made


def links(markdown: str) -> list[tuple[str, str]]:
    """Where the links and images of a page lead: file and anchor, either may be empty."""
    found = []
    for _, line in prose(markdown):
        for link in LINK.finditer(_SHOWN.sub(lambda match: "x" * len(match[0]), line)):
            found.append((link[3], (link[4] or "").removeprefix("#")))
    return found
