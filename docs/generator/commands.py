"""The pages of commands, from the parsers of the command line."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from docs.generator.markdown import code, fence, plain, table
from koord.cli.exits import Exit
from koord.cli.main import COMMANDS, EPILOG, CommandEntry, Parser

FOLDER = "reference/commands"


def pages() -> dict[str, str]:
    """A page of each command, and one that lists them."""
    return {
        f"{FOLDER}/index.md": _index(),
        **{f"{FOLDER}/{entry.name}.md": _page(entry) for entry in COMMANDS},
    }


def _index() -> str:
    rows = [(f"[`koord {one.name}`]({one.name}.md)", plain(one.summary)) for one in COMMANDS]
    codes = [(str(code.value), _meaning(code)) for code in Exit if code is not Exit.PIPE_CLOSED]
    return (
        "# Commands\n\n"
        "Generated from the command line. `koord COMMAND --help` prints the same.\n\n"
        + table(("command", "what it does"), rows)
        + "\n## Exit codes\n\nThey are the same for every command.\n\n"
        + table(("code", "meaning"), codes)
        + "\n`NO_COLOR=1` turns colours off. `KOORD_DEBUG=1` shows the traceback of an internal "
        "error.\n"
    )


def _meaning(wanted: Exit) -> str:
    """What the help of koord says of an exit code."""
    lines = EPILOG.split("\n")
    (at,) = (i for i, line in enumerate(lines) if line.split()[:1] == [str(wanted.value)])
    told = [lines[at].split(maxsplit=1)[1]]
    for line in lines[at + 1 :]:
        if not line.startswith("      "):
            break
        told.append(line.strip())
    return plain(" ".join(told))


def parser(entry: CommandEntry) -> argparse.ArgumentParser:
    """The parser of a command."""
    made = Parser(f"koord {entry.name}", f"{entry.summary.capitalize()}.")
    entry.load().configure(made)
    return made


def _page(entry: CommandEntry) -> str:
    made = parser(entry)
    made.formatter_class = _wide
    text = f"# koord {entry.name}\n\n{plain(entry.summary).capitalize()}.\n\n"
    text += fence("text", made.format_usage().removeprefix("usage: "))
    formatter = made._get_formatter()
    for group in made._action_groups:
        rows = list(_rows(formatter, group))
        if rows:
            title = (group.title or "arguments").capitalize()
            text += f"\n## {title}\n\n"
            if group.description:
                text += f"{plain(group.description)}\n\n"
            text += table(("argument", "meaning"), rows)
    if made.epilog:
        text += f"\n## Notes\n\n{fence('text', made.epilog)}"
    return text


def _rows(
    formatter: argparse.HelpFormatter, group: argparse._ArgumentGroup
) -> Iterator[tuple[str, str]]:
    for action in group._group_actions:
        if action.help == argparse.SUPPRESS:
            continue
        value = formatter._format_args(action, formatter._get_default_metavar_for_optional(action))
        names = action.option_strings or [formatter._format_action_invocation(action)]
        if not action.option_strings:
            shown = [code(value)]
        elif action.nargs == 0:
            shown = [code(name) for name in names]
        else:
            shown = [code(f"{name} {value}") for name in names]
        said = formatter._expand_help(action) if action.help else ""
        yield ", ".join(shown), plain(said)


def _wide(prog: str) -> argparse.HelpFormatter:
    """The layout: the same however wide the terminal is."""
    return argparse.RawDescriptionHelpFormatter(prog, width=80)
