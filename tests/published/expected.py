"""Which published files are meant to be bad, and why; and which are older than the grammar."""

from __future__ import annotations

import re
from collections.abc import Mapping
from hashlib import sha1
from pathlib import Path

#: Programs that are bad examples, by the ends of their names: codes of which one has to be told.
BAD_PROGRAMS = {
    "assign_to_readonly": ("K212",),  # the entry of another robot is written
    "badassign": ("K213", "K229"),  # a sensor is written; a number has no elements
    "badfile": ("K141",),  # there is no section
    "badlog": ("K238",),  # what is no stream is written to
    "badscope": ("K202", "K229"),  # a function that nobody declares; a number has no elements
    "badtype": ("K204", "K229"),  # a truth value as a position, or in a sum
    "multipledecl": ("K208",),  # one name twice
    "test1": ("K201",),  # a part of a program, without its variables
}

#: Programs of before the grammar, by their digests in Git: why nobody could bring them over.
OLDER_PROGRAMS = {
    "fcee5688": "a sketch: comments as in C, guards with statements in them, events left to do",
    "df354c05": "stages by `def stage {…}`, `null`, and methods of another language's maps",
    "38efbe24": "`for (i = 0, i < length, i = i + 1)`, and names that nothing declares",
}

#: Configurations and scenes that cannot be read, by the ends of their names, and the codes of why.
BAD_DOCUMENTS = {
    "zero_agents.global": ("K931",),  # nobody is there
    "motion_2_drones.global": ("K931",),  # agents are on devices that there are not
    "acas_0_0_0": ("K930",),  # arrays of NumPy as they are printed, in the place of numbers
}


def codes_of(path: Path, bad: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """The codes for a file that is meant to be bad; none for another one.

    A name may have the digest of its file behind it: ``badtype-510ad6.koord``.
    """
    for name, codes in bad.items():
        if re.search(rf"(?:^|_){re.escape(name)}(?:-[0-9a-f]{{6}})?$", path.stem):
            return codes
    return ()


def older(path: Path) -> str:
    """Why a program is older than the grammar; empty for another one."""
    data = path.read_bytes()
    digest = sha1(b"blob %d\0" % len(data) + data).hexdigest()
    return OLDER_PROGRAMS.get(digest[:8], "")
