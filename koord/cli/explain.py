"""``koord explain K204``: the long story of a diagnostic, with an example and its cure."""

from __future__ import annotations

import argparse
import sys
from argparse import ArgumentTypeError
from collections.abc import Iterator
from textwrap import wrap

from koord.api.documents import codes, explain
from koord.api.results import ArgumentError
from koord.cli.exits import Exit
from koord.cli.terminal import PLAIN, Paint, Style, style_of
from koord.syntax.catalogue import Story

#: Longer lines of prose are tiresome to read, however wide the terminal.
WIDEST = 88


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "code", metavar="CODE", nargs="?", help="a code such as K204; without one, all are listed"
    )


def main(arguments: argparse.Namespace) -> int:
    style = style_of(sys.stdout)
    if arguments.code is None:
        for code, entry in codes().items():
            print(f"{style.paint(code, Paint.BOLD)}  {entry.severity.value:<7}  {entry.title}")
        return Exit.OK
    try:
        entry = explain(arguments.code)
    except ArgumentError as error:
        raise ArgumentTypeError(error.message) from None
    print("\n".join(story(entry, style)))
    return Exit.OK


def story(entry: Story, style: Style = PLAIN) -> Iterator[str]:
    """The lines that tell of one code."""
    paint = Paint.ERROR if entry.severity.value == "error" else Paint.WARNING
    yield f"{style.paint(f'{entry.severity.value} {entry.code}', paint)}: {entry.title}"
    for paragraph in entry.story.strip().split("\n\n"):
        yield ""
        yield from wrap(" ".join(paragraph.split()), min(style.width, WIDEST))
    yield from _example(
        "This is refused" if paint is Paint.ERROR else "This is warned of", entry.bad
    )
    yield from _example("This is right", entry.good)


def _example(title: str, text: str) -> Iterator[str]:
    if text.strip():
        yield ""
        yield f"{title}:"
        yield ""
        for line in text.strip("\n").splitlines():
            yield f"    {line}".rstrip()
