"""A run as all of its robots know it, and the robots that take part in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from hashlib import blake2b
from pathlib import Path
from typing import Any

from msgspec import Struct

from koord.runtime.compile.watching import Watched
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.deploy.ideal import IdealHost
from koord.runtime.deploy.joining import drawn
from koord.runtime.deploy.journal import Journal
from koord.runtime.deploy.member import Member, Platform
from koord.runtime.encoding import text_digest
from koord.runtime.protocol.handshake import Fingerprint, Party
from koord.runtime.robot import Robot
from koord.runtime.wire.frames import fleet_key
from koord.syntax.diagnostics import Diagnostic
from koord.version import __version__


class CannotTakePartError(Exception):
    """Raised where a robot cannot take part in a run, with a cure. (R-NAME)

    ``file`` is the journal, if that is why.
    """

    def __init__(self, message: str, hint: str, file: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.file = file

    def __reduce__(self) -> tuple[type[CannotTakePartError], tuple[str, str, str]]:
        return type(self), (self.message, self.hint, self.file)


def print_of(key: bytes, run: str) -> str:
    """A digest by which a key is known again, in runs of this name."""
    return blake2b(b"journal", key=fleet_key(key, run), digest_size=16).hexdigest()


class Job(Struct, frozen=True):
    """A run, as all of its robots know it."""

    classes: tuple[type[Robot], ...]
    kinds: tuple[int, ...]
    configuration: RunConfiguration
    key: bytes
    run: str
    delta_s: float
    pace_s: float  #: how often rounds begin: δ, or 0 for as fast as it goes
    rounds: int | None
    journals: Path | None  #: the folder of the robots' journals
    unhurried_s: float = 0.1  #: as long as rounds are, for who waits, if they have no pace
    starts: Mapping[tuple[int | None, str], Any] = {}  #: by robot and attribute, if any are assumed
    program: Fingerprint = ()  #: what the robots run, by name, as texts
    insists: bool = False  #: on a new run, whatever journals say
    key_print: str = ""  #: of a key that outlasts this process: journals of others do not count
    warnings: tuple[Diagnostic, ...] = ()  #: of the key
    waits: bool = False  #: for people, who look at robots before anything is armed (P-PREFLIGHT)
    is_local: bool = False  #: all robots are processes of one machine
    platforms: Callable[[Job, int], Platform] | None = None  #: None: all robots are ideal points
    watched: Watched | None = None  #: the claims that are watched

    def platform(self, pid: int) -> Platform:
        """Make the platform of a robot. Raises CannotTakePartError."""
        return ideal_host(self, pid) if self.platforms is None else self.platforms(self, pid)

    def program_of(self, pid: int) -> type[Robot]:
        """The compiled program of a robot."""
        return self.classes[self.kinds[pid]]

    @property
    def robots(self) -> int:
        return len(self.kinds)

    @property
    def owing(self) -> frozenset[int]:
        """The robots whose programs oblige them to be heard in every round. [SKIP] (R-OWED)"""
        return frozenset(pid for pid, kind in enumerate(self.kinds) if self.classes[kind].owes())

    @property
    def encrypts(self) -> bool:
        """Whether what robots say is encrypted."""
        return self.configuration.talk.encrypts

    @property
    def fingerprint(self) -> Fingerprint:
        """What all robots have to have in common. (R-JOIN)"""
        several = len(self.classes) > 1  # else the name of the only kind is the file's
        names = ", ".join(self.classes[kind].__name__ for kind in self.kinds) if several else ""
        return (
            ("koord", __version__),
            *self.program,
            ("robots", f"{self.robots} ({names})" if several else str(self.robots)),
            ("delta", f"{self.delta_s:g} s"),
            ("pace", f"{self.pace_s:g} s"),
            ("rounds", "no end" if self.rounds is None else str(self.rounds)),
            ("leader_pid", str(self.configuration.leader)),
            ("encryption", "on" if self.encrypts else "off"),
            *((("starts", self._starts_digest),) if self.starts else ()),
        )

    @property
    def _starts_digest(self) -> str:
        text = repr(sorted(self.starts.items(), key=repr))
        return text_digest(text, 8)

    def party(self, pid: int) -> Party:
        """A robot's part in the handshake, at a new start."""
        key = fleet_key(self.key, self.run)
        leader = self.configuration.leader
        return Party(
            pid,
            self.robots,
            leader,
            drawn(),
            self.fingerprint,
            key,
            self.insists,
            self.encrypts,
        )

    def journal(self, pid: int) -> Journal | None:
        """The journal of a robot, or None."""
        if self.journals is None:
            return None
        name = text_digest(self.run, 6)
        return Journal(self.journals / f"{name}-{pid}.journal", syncs=not self.is_local)


def member_of(job: Job, pid: int) -> Member:
    """Make a robot on its platform. Raises CannotTakePartError."""
    host = job.platform(pid)
    return Member(job.program_of(pid)(pid, job.kinds, job.delta_s, host), host)


def ideal_host(job: Job, pid: int) -> IdealHost:
    """Make the host of a robot without a platform."""
    place = job.configuration.robots[pid]
    return IdealHost(
        job.program_of(pid),
        pid,
        job.robots,
        job.delta_s,
        job.configuration.seed,
        place.position,
        place.vehicle.speed_mps,
        job.configuration.world,
        job.starts,
    )


#: Makes a robot of a run.
Make = Callable[[Job, int], Member]
