"""How people get to robots' computers, what is put there, and what goes wrong with it."""

from __future__ import annotations

from pathlib import PurePosixPath

from msgspec import Struct

#: The folder with the runs of a robot's computer, in the home of who logs in there.
RUNS = PurePosixPath(".koord/runs")


class Login(Struct, frozen=True):
    """How people log in to robots' computers. What is not said is as OpenSSH has it. (P-SSH)

    ``koord`` is the command there, ``config`` a file as ``~/.ssh/config``, instead of that.
    """

    user: str | None = None
    identity: str | None = None  #: the file of a private key
    koord: str = "koord"
    config: str | None = None


class RemoteFile(Struct, frozen=True):
    """A file that is copied to a robot's computer, by its name in the folder of the run there."""

    name: str
    data: bytes


class RemoteError(Exception):
    """Raised for a computer that cannot be used: what is wrong with it, and a cure."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message, self.hint = message, hint


class LostError(Exception):
    """Raised where a connection was lost that there was."""


class RemoteEnd(Struct, frozen=True):
    """The end of a command on a robot's computer: its exit code, and what it has printed.

    ``code`` is None if it is not known; ``lost`` says why. ``last`` is its last line.
    """

    code: int | None
    printed: bytes = b""
    last: str = ""
    lost: str = ""

    @property
    def signal(self) -> int | None:
        """The signal that ended it, as shells tell."""
        return self.code - 128 if self.code is not None and 128 < self.code < 160 else None


class RemotePlace(Struct, frozen=True):
    """Where the files of a robot lie: its host, and the folder in the home there."""

    host: str
    folder: PurePosixPath

    def file(self, name: str) -> str:
        """A file, as ``scp`` takes it."""
        return f"{self.host}:{self.folder / name}"
