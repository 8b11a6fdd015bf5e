"""Configurations as they are typed: whether a text is one, with what it is read, its mistakes."""

from __future__ import annotations

import re
from pathlib import Path

from msgspec import Struct

from koord.api.configurations import check_configuration
from koord.api.fitting import can_be_placed
from koord.api.program_files import Folder, OpenTexts, beside, flags_said, program_beside
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


#: A comment of a configuration that says with what it is checked, and so run.
SAID = re.compile(r"^[ \t]*#[ \t]*koord config check:(.*)$", re.MULTILINE)


class ConfigurationText(Struct, frozen=True):
    """A text of YAML that is the configuration of a run, or its site, and what it is read with.

    A file that cannot be read is here by its name.
    """

    source: Source
    main: Source  #: the configuration: itself, unless the text is the site of one
    program: Source | None = None
    site: Source | str | None = None
    scene: Source | str | None = None

    @property
    def others(self) -> tuple[Source, ...]:
        """The other texts that it is about."""
        given = (self.main, self.program, self.site, self.scene)
        return tuple(one for one in given if isinstance(one, Source) and one is not self.source)


class CheckedText(Struct, frozen=True):
    """What is wrong with a text, and the other texts that this is about: that of its program."""

    source: Source
    diagnostics: tuple[Diagnostic, ...] = ()
    others: tuple[Source, ...] = ()


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


def configuration_text(
    name: str, path: Path | None, text: str, opened: OpenTexts
) -> ConfigurationText | None:
    """A text of YAML with what it is read with; None if it is no configuration of a run.

    A configuration says its site, and its scene, in a comment, as ``koord config check`` is told:

        # koord config check: --site lab.yaml --scene start.yml
    """
    source = Source(name, normalise(text))
    if is_configuration(source.text):
        if path is None:
            return ConfigurationText(source, source)
        program, site, scene = _read_with(path, source.text, opened)
        return ConfigurationText(source, source, program, site, scene)
    if path is None:
        return None
    folder = Folder(path, text, opened)
    for main in folder.configurations():
        found = folder.text(main)
        if found is None or not is_configuration(found):
            continue
        sites = [value for flag, value in flags_said(SAID, found) if flag == "--site"]
        if sites and beside(main, sites[-1]) == path:
            program, _, scene = _read_with(main, found, opened)
            whole = Source(main.name, normalise(found))
            return ConfigurationText(source, whole, program, source, scene)
    return None


def _read_with(
    path: Path, text: str, opened: OpenTexts
) -> tuple[Source | None, Source | str | None, Source | str | None]:
    """The program of a configuration, its site and its scene."""
    folder = Folder(path, text, opened)
    said = dict(flags_said(SAID, text))

    def read(flag: str, *, whole_path: bool = False) -> Source | str | None:
        if flag not in said:
            return None
        there = beside(path, said[flag])
        found = folder.text(there)
        if found is None:
            return str(there)
        return Source(str(there) if whole_path else said[flag], normalise(found))

    # what a scene is in, a world of Gazebo, is looked for beside it
    return program_beside(path, opened), read("--site"), read("--scene", whole_path=True)


def checked_text(name: str, path: Path | None, text: str, opened: OpenTexts) -> CheckedText:
    """Check a text of YAML, with the program that it is named like, its site and its scene.

    Of the site of a configuration what is wrong there is told. A file that is neither has no
    mistakes: it is somebody else's.
    """
    known = configuration_text(name, path, text, opened)
    if known is None:
        return CheckedText(Source(name, normalise(text)))
    report = check_configuration(known.main, known.program, known.site, known.scene)
    found = report.diagnostics
    if known.main is not known.source:
        found = tuple(one for one in found if one.span.file == known.source.name)
    elif any(one.code == _MISREAD for one in found):
        return CheckedText(known.source)
    return CheckedText(known.source, found, known.others)


def load_libraries() -> None:
    """Load what places robots in their world, which takes seconds when it is needed first."""
    if can_be_placed():
        import koord.api.sim_setup
        import koord.sim.scene  # noqa: F401
