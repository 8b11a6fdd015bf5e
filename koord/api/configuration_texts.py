"""Configurations as they are typed: whether a text is one, and what is wrong with it."""

from __future__ import annotations

import re
from pathlib import Path

from msgspec import Struct

from koord.api.configurations import check_configuration
from koord.api.fitting import can_be_placed
from koord.api.program_files import OpenTexts, program_beside
from koord.runtime.configuration.forms import Form
from koord.syntax.diagnostics import Diagnostic
from koord.syntax.source import Source, normalise

#: Fields for robots and devices: each form of configurations has some of them.
_ROBOTS = {"agent", "agents", "bots", "device", "devices", "num_agents", "num_robots", "robot"}

_FIELDS = frozenset(Form.__struct_fields__)

#: The name of an outermost field. It is found in texts that are not YAML yet, too.
_NAME = re.compile(r"^([\"']?)([A-Za-z_]\w*)\1[ \t]*:(?=\s|$)", re.MULTILINE)

#: The code of files that look like configurations, and are something else.
_MISREAD = "K951"


class CheckedText(Struct, frozen=True):
    """What is wrong with a text, and the other texts that this is about: that of its program."""

    source: Source
    diagnostics: tuple[Diagnostic, ...] = ()
    program: Source | None = None


def is_configuration(text: str) -> bool:
    r"""Whether a text of YAML is the configuration of a run; it may have mistakes.

    It has a field for robots or devices, and at least half of its fields are those of
    configurations: files of other tools have `agents:`, too.

    >>> is_configuration("num_robots: 3\ndetla: 0.1\n")
    True
    >>> is_configuration("name: ci\non: push\n")
    False
    """
    names = outermost_fields(text)
    return not names.isdisjoint(_ROBOTS) and 2 * len(names & _FIELDS) >= len(names)


def outermost_fields(text: str) -> set[str]:
    """The names of the outermost fields of a text of YAML, which may have mistakes."""
    return {name for _, name in _NAME.findall(text)}


def checked_text(name: str, path: Path | None, text: str, opened: OpenTexts) -> CheckedText:
    """Check a text of YAML, and the program that it is named like with it.

    A file that is no configuration of a run has no mistakes: it is somebody else's.
    """
    source = Source(name, normalise(text))
    if not is_configuration(source.text):
        return CheckedText(source)
    program = None if path is None else program_beside(path, opened)
    found = check_configuration(source, program).diagnostics
    if any(one.code == _MISREAD for one in found):
        return CheckedText(source)
    return CheckedText(source, found, program)


def load_libraries() -> None:
    """Load what places robots in their world, which takes seconds when it is needed first."""
    if can_be_placed():
        import koord.api.sim_setup
        import koord.sim.scene  # noqa: F401
