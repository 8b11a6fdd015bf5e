"""All pages of the site: those in `docs/`, those that are generated, and files of the project.

A link between files of the project leads to the page of its target, if that is part of the site.
Specifications and guides are part of it if a page leads there, as are programs and configurations;
other files are named without a link.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from docs.generator import commands, configuration, diagnostics, formats, library, python_api
from docs.generator.markdown import LINK, fence, links, prose

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"

#: Files that are shown as text, by the end of their name, and the language of it.
SHOWN = {".krd": "koord", ".yaml": "yaml", ".json": "json"}

_PICTURES = (".png", ".svg")

_CODE = re.compile(r"`[^`]*`")

#: What the site has elsewhere.
_ELSEWHERE = {"README.md": "index.md"}

#: Records and guides that search need not find before the pages of the site.
_QUIET = ("specs/decisions/", "specs/examples/", "CHANGELOG.md")


@cache
def generated() -> Mapping[str, str]:
    """The pages that no file has, by their place in the site."""
    made: dict[str, str] = {}
    for maker in (commands, configuration, diagnostics, formats, library, python_api):
        for place, text in maker.pages().items():
            assert place not in made
            made[place] = text
    return made


class Site:
    """The pages of the site by their places, with links that lead from page to page.

    Files of the project that are ``wanted`` are part of it, whether a page leads there or not.
    """

    def __init__(self, wanted: Iterable[str] = (), docs: Path = DOCS) -> None:
        self._wanted, self._docs = tuple(wanted), docs

    @cached_property
    def pages(self) -> dict[str, str]:
        """Every page, by its place."""
        made = {place: text for place, text in self._written()}
        made |= generated()
        self._seen.update(dict.fromkeys(self._wanted))
        waiting = [file for file in self._seen if not file.startswith("docs/")]
        while waiting:
            file = waiting.pop()
            place = self.place(file)
            if place is None or place in made or file in _ELSEWHERE or file.endswith(_PICTURES):
                continue
            before = len(self._seen)
            made[place] = self._of_project(file)
            waiting += list(self._seen)[before:]
        return made

    @cached_property
    def pictures(self) -> dict[str, Path]:
        """Pictures of the project that pages show, by their place."""
        assert self.pages
        return {file: ROOT / file for file in self._seen if file.endswith(_PICTURES)}

    @cached_property
    def _seen(self) -> dict[str, None]:
        """Files of the project that pages lead to, in the order in which that was seen."""
        return {}

    def _written(self) -> Iterator[tuple[str, str]]:
        for path in sorted(self._docs.rglob("*.md")):
            place = path.relative_to(self._docs).as_posix()
            yield place, self.linked(f"docs/{place}", path.read_text(encoding="utf-8"))

    def _of_project(self, file: str) -> str:
        text = (ROOT / file).read_text(encoding="utf-8")
        suffix = Path(file).suffix
        if suffix in SHOWN:
            return f"# {Path(file).name}\n\n`{file}`\n\n{fence(SHOWN[suffix], text)}"
        return self.linked(file, text)

    def place(self, file: str) -> str | None:
        """The place in the site of a file of the project; None if it has none."""
        if file in _ELSEWHERE:
            return _ELSEWHERE[file]
        if file.startswith("docs/"):
            return file.removeprefix("docs/")
        path = ROOT / file
        if path.is_dir():
            file = f"{file}/README.md"
            path = ROOT / file
        if not path.is_file():
            return None
        if file.endswith((".md", *_PICTURES)):
            return file
        return f"{file}.md" if path.suffix in SHOWN else None

    def linked(self, file: str, text: str) -> str:
        """The text of a file of the project, with links as they are in the site."""
        here = self.place(file)
        assert here is not None

        def replaced(match: re.Match[str]) -> str:
            mark, shown, target, anchor = match[1], match[2], match[3], match[4] or ""
            if not target or "://" in target or target.startswith("mailto:"):
                return match[0]
            there = posixpath.normpath(posixpath.join(posixpath.dirname(file), target))
            place = self.place(there)
            if place is None or there.startswith(".."):
                return shown
            if (ROOT / there).is_dir():
                there = f"{there}/README.md"
            self._seen[there] = None
            relative = posixpath.relpath(place, posixpath.dirname(here) or ".")
            return f"{mark}[{shown}]({relative}{anchor})"

        return _outside_of_code(text, replaced)

    def search_excluded(self, place: str) -> bool:
        """Whether search leaves a page out."""
        return place.startswith(_QUIET)


def _outside_of_code(text: str, replaced: Callable[[re.Match[str]], str]) -> str:
    """Replace the links of a text, where it is neither a block nor a piece of code."""
    lines = text.split("\n")
    for i, line in prose(text):
        if "](" in line:
            lines[i] = _linked_line(line, replaced)
    return "\n".join(lines)


def _linked_line(line: str, replaced: Callable[[re.Match[str]], str]) -> str:
    # Backquotes within what a link shows are part of it.
    kept = [range(*match.span()) for match in _CODE.finditer(line) if "](" in match[0]]
    return LINK.sub(
        lambda m: m[0] if any(m.start() in where for where in kept) else replaced(m), line
    )


#: The folders whose pages are listed in the navigation as they are generated.
LISTED = (commands.FOLDER, diagnostics.FOLDER, formats.FOLDER)


def filled(nav: list[Any]) -> list[Any]:
    """The navigation, with the generated pages of a folder behind the page that lists them."""
    made: list[Any] = []
    for item in nav:
        if isinstance(item, dict):
            made.append(
                {
                    title: filled(below) if isinstance(below, list) else below
                    for title, below in item.items()
                }
            )
            continue
        made.append(item)
        folder = posixpath.dirname(item)
        if folder in LISTED and item.endswith("/index.md"):
            made += [
                {_title(text): place}
                for place, text in generated().items()
                if posixpath.dirname(place) == folder and place != item
            ]
    return made


def in_navigation(nav: list[Any]) -> list[str]:
    """The places of all pages in a navigation."""
    found: list[str] = []
    for item in nav:
        if isinstance(item, str):
            found.append(item)
        else:
            for below in item.values():
                found += in_navigation(below if isinstance(below, list) else [below])
    return found


def in_project(places: Iterable[str]) -> list[str]:
    """Those places that files of the project have."""
    return [place for place in places if (ROOT / place).is_file()]


def _title(text: str) -> str:
    """The heading of a page, without the name of the tool."""
    return text.partition("\n")[0].removeprefix("# ").removeprefix("koord ")


def dead_links(pages: dict[str, str], known: dict[str, set[str]]) -> list[str]:
    """Links within the site that lead nowhere: page, and where they lead."""
    dead = []
    for place, text in pages.items():
        for target, anchor in links(text):
            if "://" in target or target.startswith("mailto:"):
                continue
            there = posixpath.normpath(posixpath.join(posixpath.dirname(place), target))
            there = there if target else place
            if there not in known:
                dead.append(f"{place}: {target}")
            elif anchor and anchor not in known[there]:
                dead.append(f"{place}: {target}#{anchor}")
    return dead
