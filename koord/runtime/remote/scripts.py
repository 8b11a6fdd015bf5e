"""The shell scripts by which commands run on a robot's computer, whoever stays connected.

They are for any POSIX shell. A command NAME leaves NAME.out and NAME.log (its standard output and
standard error), NAME.pid, and NAME.code (its exit code) when it has ended. (P-SSH-GOES-ON)
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePosixPath
from shlex import join, quote

#: The file of a key that people have in their environment here.
KEY = "environment.key"


def start_script(name: str, words: Sequence[str], *, has_key: bool) -> bytes:
    """A script that starts a command in its own folder, and ends when the command is under way."""
    key = f'KOORD_KEY="$(cat {KEY})" && export KOORD_KEY\n' if has_key else ""
    return (
        "#!/bin/sh\n"
        f"# written by koord deploy --ssh; {name}.pid is the process, SIGTERM stops it safely\n"
        'cd "$(dirname "$0")" || exit 1\n'
        "umask 077\n"
        f"rm -f {name}.code {name}.pid\n"
        f"{key}"
        "{\n"
        f"  {_in_home(words)} </dev/null >{name}.out 2>{name}.log &\n"
        f"  echo $! >{name}.pid\n"
        "  wait $!\n"
        f"  echo $? >{name}.part && mv {name}.part {name}.code\n"
        "} </dev/null >/dev/null 2>&1 &\n"
        f"until [ -s {name}.pid ]; do sleep 0.1; done\n"
    ).encode()


def _in_home(words: Sequence[str]) -> str:
    """A command line whose command may begin with ``~/``."""
    command, *rest = words
    first = f'"$HOME"/{quote(command[2:])}' if command.startswith("~/") else quote(command)
    return f"{first} {join(rest)}" if rest else first


def version_command(koord: str) -> str:
    """What asks for the version there."""
    return f"sh -c {quote(_in_home((koord, '--version')))}"


def start_command(folder: PurePosixPath, name: str) -> str:
    """What starts a command whose script is there."""
    return join(("sh", str(folder / f"{name}.sh")))


def stop_command(folder: PurePosixPath, name: str) -> str:
    """What sends a command SIGTERM, unless it has ended."""
    inside = f'cd {quote(str(folder))} && [ ! -e {name}.code ] && kill -TERM "$(cat {name}.pid)"'
    return f"sh -c {quote(inside)}"


def is_there_command(folder: PurePosixPath, name: str) -> str:
    """What fails if a command has neither ended nor is running."""
    ended = f"[ -e {name}.code ]"
    # What has just ended has written its code in a moment.
    found = f'{ended} || kill -0 "$(cat {name}.pid)" || {{ sleep 1; {ended}; }}'
    inside = f"cd {quote(str(folder))} && {{ {found}; }}"
    return f"sh -c {quote(inside)}"
