"""What a run needs on the computers of its robots: their addresses, and the files that are copied.

(P-SSH-COPY)
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from msgspec import Struct

from koord.api.deploy_setup import keyless
from koord.api.files import read_bytes
from koord.api.fitting import FitRequest
from koord.runtime.configuration.keys import VARIABLE, shared_key
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.remote.logins import RemoteFile
from koord.runtime.remote.scripts import KEY
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity, refusal


def hosts_of(configuration: RunConfiguration) -> Iterator[tuple[int, str]]:
    """Yield each robot with its computer. Raises KoordError if some have none. (K932)"""
    missing = []
    for robot in configuration.robots:
        path = (*robot.vehicle.path, "ip")
        if path not in configuration.document.spans:
            story = f"robot {robot.pid} has no computer: its device has no `ip`"
            hint = "write that of its computer: `ip: 192.168.1.17`"
            place = configuration.place(*robot.vehicle.path)
            missing.append(Diagnostic("K932", Severity.ERROR, place, story, hint))
        yield robot.pid, robot.address[0]
    if missing:
        raise KoordError(tuple(dict.fromkeys(missing)))


class Copied(Struct, frozen=True):
    """The files of a run as they are copied, and the words that name them there. (P-SSH-COPY)"""

    files: tuple[RemoteFile, ...]
    words: tuple[str, ...]  #: behind ``koord deploy``
    has_key: bool  #: the key is that of people's environment here


def copied(wanted: FitRequest, configuration: RunConfiguration, rests_on: str | None) -> Copied:
    """The files of a run as they are copied. Raises KoordError."""
    key = shared_key(configuration)
    if key is None:
        raise KoordError((keyless(configuration),))
    files: dict[str, bytes] = {}

    def add(path: str, data: bytes) -> str:
        name = Path(path).name.lstrip("-<").rstrip(">") or "file"
        while name in files:
            name = f"_{name}"
        files[name] = data
        return name

    key_file = configuration.talk.key_file
    has_key = VARIABLE in os.environ
    if has_key:
        files[KEY] = key.key
    elif key_file is not None:
        inside = PurePosixPath(key_file)
        if inside.is_absolute() or ".." in inside.parts:
            story = f"the key {key_file} does not lie beside the configuration, as it will there"
            hint = f"copy it there: `key_file: {inside.name}`; or set {VARIABLE} here"
            raise refusal("K932", configuration.name, story, hint)
        files[str(inside)] = key.key
    words = [
        add(wanted.source.name, wanted.source.text.encode()),
        add(configuration.name, configuration.document.source.text.encode()),
    ]
    site = configuration.document.site
    if site is not None:
        words.append(f"--site={add(site.name, site.text.encode())}")
    words += [f"--with={add(one.name, one.text.encode())}" for one in wanted.properties]
    if rests_on is not None:
        words.append(f"--rests-on={add(rests_on, read_bytes(rests_on))}")
    made = tuple(RemoteFile(name, data) for name, data in files.items())
    return Copied(made, tuple(words), has_key)
