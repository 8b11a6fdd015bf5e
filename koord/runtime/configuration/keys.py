"""The key that robots share: where it comes from, and what is wrong with it.

It is a text of one line. The environment variable counts before the file of a key, and that before
a key in the configuration itself. What is said of a key never shows it.
"""

from __future__ import annotations

import os
import re
import secrets
import stat
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path

from msgspec import Struct

from koord.runtime.configuration.model import RunConfiguration
from koord.syntax.diagnostics import Diagnostic, Severity, refusal
from koord.syntax.source import whole_file

#: The environment variable with the key.
VARIABLE = "KOORD_KEY"

LEAST_BYTES = 16

#: Keys with fewer different characters are typed, not drawn; of 64 hexadecimal digits all 16 occur.
_LEAST_DIFFERENT = 7

#: What everybody would try first, whatever digits are added.
_WORDS = frozenset(
    ("changeme", "default", "example", "key", "koord", "password", "robots", "secret", "test")
)

#: Larger files are no keys.
_LARGEST = 4096

#: The permission bits of everybody but the owner, and of those that are not in the group either.
_OTHERS, _EVERYBODY = 0o077, 0o004

HINT = "`koord config key FILE` writes a new key"


def new_key() -> str:
    """A key that nobody can guess: 256 random bits, as 64 hexadecimal digits."""
    return secrets.token_hex(32)


def write_key(path: str) -> None:
    """Write a new key to a new file that its owner alone can read. Raises KoordError."""
    try:
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        story = "cannot be written: there is such a file already"
        hint = "a key is never overwritten; say another name"
        raise refusal("K903", path, story, hint) from None
    except OSError as error:
        raise refusal("K903", path, f"cannot be written: {error.strerror}") from None
    try:
        with os.fdopen(file, "w", encoding="ascii") as stream:
            stream.write(new_key() + "\n")
    except OSError as error:
        os.unlink(path)  # half a key is none
        raise refusal("K903", path, f"cannot be written: {error.strerror}") from None


def weakness(key: bytes) -> str | None:
    """Return what makes a key easy to guess; None if nothing does that can be seen."""
    if len(key) < LEAST_BYTES:
        return f"a key has at least {LEAST_BYTES} bytes, and this one has {len(key)}"
    if any(key[at:] == key[:-at] for at in range(1, len(key) // 2 + 1)):
        return "this key repeats itself"
    if len(set(key)) < _LEAST_DIFFERENT:
        return f"this key has {len(set(key))} different characters"
    words = re.findall(rb"[a-z]+", key.lower())
    if words and all(word.decode() in _WORDS for word in words):
        return "this key is what everybody would try first"
    if all(b - a == 1 for a, b in pairwise(key)):
        return "this key counts up"
    return None


class SharedKey(Struct, frozen=True):
    """The key of a run, and what its owner should know of it."""

    key: bytes
    warnings: tuple[Diagnostic, ...] = ()


def shared_key(
    configuration: RunConfiguration, environment: Mapping[str, str] = os.environ
) -> SharedKey | None:
    """The key that a configuration and the environment give robots; None: there is none.

    Raises KoordError if it may not be used. (K932)
    """
    talk, name = configuration.talk, configuration.place("network").file
    warnings = () if talk.key is None else tuple(_lying_open(name))
    given = environment.get(VARIABLE)
    if given is None:
        key = talk.key if talk.key_file is None else _read(Path(name).parent / talk.key_file)
        return None if key is None else SharedKey(key, warnings)
    key = given.encode(errors="surrogateescape")
    if story := weakness(key):
        raise refusal("K932", name, f"{VARIABLE}: {story}", HINT)
    if talk.key_file is not None or talk.key not in (None, key):
        where = "key" if talk.key_file is None else "key_file"
        story = f"the key is that of {VARIABLE}, and not that of `network: {{{where}: …}}`"
        hint = f"leave one of them out, or unset {VARIABLE}"
        warnings += (Diagnostic("K945", Severity.WARNING, whole_file(name), story, hint),)
    return SharedKey(key, warnings)


def _lying_open(name: str) -> Iterator[Diagnostic]:
    """Warn of a configuration with a key that everybody on this machine can read. (K945)"""
    try:
        mode = Path(name).stat().st_mode
    except (OSError, ValueError):
        return  # it is no file
    if os.name == "posix" and mode & _EVERYBODY:
        story = "the key in this file can be read by everybody on this machine"
        hint = f"chmod 600 {name}, or move the key to a file of its own: `network: {{key_file: …}}`"
        yield Diagnostic("K945", Severity.WARNING, whole_file(name), story, hint)


def _read(path: Path) -> bytes:
    """Read the file of a key. Raises KoordError."""
    name = str(path)
    try:
        # A pipe is not waited for: it is none of the files that may be read.
        file = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except OSError as error:
        raise refusal("K932", name, f"the key cannot be read: {error.strerror}", HINT) from None
    try:
        status = os.fstat(file)
        if not stat.S_ISREG(status.st_mode):
            raise refusal("K932", name, "this is no file with a key", HINT)
        if os.name == "posix" and status.st_mode & _OTHERS:
            mode = stat.S_IMODE(status.st_mode)
            story = f"others can read this key, or change it (mode {mode:03o})"
            raise refusal("K932", name, story, f"chmod 600 {name}")
        read = os.read(file, _LARGEST + 1)
    finally:
        os.close(file)
    key = read.removesuffix(b"\n").removesuffix(b"\r")
    if len(read) > _LARGEST or b"\n" in key or b"\r" in key:
        raise refusal("K932", name, "a key is a text of one line", HINT)
    weak = weakness(key)
    if weak is not None:
        raise refusal("K932", name, weak, HINT)
    return key
