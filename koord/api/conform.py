"""Conformance: what every driver passes, against the other side of its wire."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import msgspec
from msgspec import Struct, to_builtins

from koord.api.drivers import registry
from koord.api.programs import source_of
from koord.api.progress import Cancellation, Listener, Progress, asker, heard_by
from koord.api.results import ArgumentError, Result, html_table
from koord.syntax.diagnostics import KoordError, refusal

if TYPE_CHECKING:
    from koord.testing.conformance.bench import Check
    from koord.testing.conformance.findings import Finding as Finding
    from koord.testing.conformance.peers import CommandPeer
    from koord.testing.conformance.subjects import Subject

#: The driver of simulated vehicles, which are in the process that drives them.
_SIMULATED = "sim"

#: The vehicle where nobody says which.
_USUAL = "DIFF"


class ConformRequest(Struct, frozen=True, kw_only=True):
    """A request to test a driver; None: as the peer or the driver has it."""

    driver: str | None = None
    options: Mapping[str, Any] | None = None
    vehicle: str | None = None
    peer: str | None = None
    at_m: tuple[float, float, float] | None = None
    heading_rad: float = 0.0
    room_m: float = 4.0
    arm: bool = False
    virtual_time: bool | None = None
    only: tuple[str, ...] = ()
    jobs: int = 1


class Conformance(Result, frozen=True, kw_only=True):
    """What the checks of a driver found, in the order of the suite."""

    driver: str
    vehicle: str
    peer: str | None
    findings: tuple[Finding, ...]
    interrupted: bool = False

    def count(self, verdict: str) -> int:
        """How many checks have ``passed``, ``failed``, or were ``skipped``."""
        return sum(one.verdict.value == verdict for one in self.findings)

    @property
    def failed(self) -> tuple[Finding, ...]:
        """What must not be."""
        return tuple(one for one in self.findings if one.verdict.value == "failed")

    @property
    def ok(self) -> bool:
        """True if no check failed, some passed, and nobody cut them short."""
        return not self.failed and not self.interrupted and self.count("passed") > 0

    def to_dict(self) -> dict[str, object]:
        """The result as plain data, as ``koord conform --json`` prints it."""
        return {
            "format": "koord-conformance",
            "version": 1,
            "driver": self.driver,
            "vehicle": self.vehicle,
            "peer": self.peer,
            "ok": self.ok,
            "interrupted": self.interrupted,
            "checks": [to_builtins(one) for one in self.findings],
        }

    def __repr__(self) -> str:
        names = ", ".join(one.check for one in self.failed)
        said = f"failed: {names}" if names else "nothing failed"
        return f"<Conformance of {self.driver}: {self.count('passed')} passed, {said}>"

    def _repr_html_(self) -> str:
        rows = [(one.check, one.verdict.value, told(one)) for one in self.findings]
        return html_table(repr(self), ("check", "verdict", "seen"), rows)


def told(finding: Finding) -> str:
    """What a check saw, with the limits; or why it was not made."""
    if finding.why:
        return f"{finding.why}; {finding.cure}" if finding.cure else finding.why
    return "; ".join(
        one.seen + (f" ({one.limit})" if one.limit else "") for one in finding.measures
    )


def conform(
    driver: str | None = None,
    *,
    options: Mapping[str, Any] | None = None,
    vehicle: str | None = None,
    peer: str | None = None,
    at_m: tuple[float, float, float] | None = None,
    heading_rad: float = 0.0,
    room_m: float = 4.0,
    arm: bool = False,
    virtual_time: bool | None = None,
    only: Sequence[str] = (),
    jobs: int = 1,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Conformance:
    """Test a driver by the conformance kit: all that koord takes for granted of drivers.

    ``driver`` is a name of :func:`installed_drivers`, or ``module:object``; ``options`` are its
    own, ``vehicle`` is a type of vehicle (``CAR``). ``peer`` is the other side of its wire: the
    name of one that comes with koord (``px4``), with its driver, options and vehicle; or a command,
    which is started, frozen and ended. Without one the vehicle is a real one, which stands at
    ``at_m`` (metres) and points to ``heading_rad``, or the driver ``sim``. It moves only if there
    is a peer, or people say that it may by ``arm``: up to 2 m, and up to 2 m high;
    ``room_m`` about it is its world. In ``virtual_time`` the vehicle moves by the times that its
    driver is told, as simulated ones do. ``only`` are names of checks, if not all are to be made.

    With ``jobs`` so many groups of checks are made at once, each in a process of its own against a
    peer of its own. A command has place-holders for that, and so have the options: ``{free}`` is a
    free port, ``{domain}`` a domain of DDS, ``{job}`` a number that counts from 0.

    Raises :class:`koord.ArgumentError` for what cannot be, and :class:`koord.KoordError` for
    drivers that cannot be loaded.

    >>> koord.conform("sim", vehicle="CAR").ok
    True
    """
    request = ConformRequest(
        driver=driver,
        options=options,
        vehicle=vehicle,
        peer=peer,
        at_m=at_m,
        heading_rad=heading_rad,
        room_m=room_m,
        arm=arm,
        virtual_time=virtual_time,
        only=tuple(only),
        jobs=jobs,
    )
    return conform_request(request, progress, cancellation)


def conform_request(
    request: ConformRequest,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
    heard: Callable[[Finding], None] = lambda finding: None,
) -> Conformance:
    """Test a driver; ``heard`` is told of each check when it has been made. Raises KoordError."""
    import koord.api.sim_libraries  # noqa: F401
    from koord.testing.conformance.running import NAMES

    tell, is_cancelled = heard_by(progress), asker(cancellation)
    names = _known(request.only, NAMES)
    subject, peer = subject_of(request)
    _can_be_made(subject.name or subject.target, subject)
    found: list[Finding] = []

    def begins(check: Check) -> None:
        tell(Progress(check.about))

    for one in _findings(request, subject, peer, names, begins, is_cancelled):
        found.append(one)
        heard(one)
    return Conformance(
        driver=subject.name or subject.target,
        vehicle=subject.vehicle,
        peer=request.peer,
        findings=tuple(sorted(found, key=lambda one: NAMES.index(one.check))),
        interrupted=len(found) < len(names),
    )


def _findings(
    request: ConformRequest,
    subject: Subject,
    peer: CommandPeer | None,
    names: tuple[str, ...],
    begins: Callable[[Check], None],
    is_cancelled: Callable[[], bool],
) -> Iterator[Finding]:
    """Make the checks, one after the other or side by side. Raises KoordError."""
    from koord.testing.conformance.beside import beside
    from koord.testing.conformance.lane import Lane
    from koord.testing.conformance.peers import KNOWN, patched
    from koord.testing.conformance.running import bench_of, conform

    environment = KNOWN[request.peer].environment if request.peer in KNOWN else {}
    if request.jobs == 1:
        with patched(environment):
            yield from conform(bench_of(subject, peer, is_cancelled=is_cancelled), names, begins)
        return
    _several(request, peer)

    def lane(job: int, checks: tuple[str, ...]) -> Lane:
        subject, peer = subject_of(request, job)
        assert peer is not None
        return Lane(subject, peer.command, environment, checks)

    yield from beside(lane, request.jobs, names, begins, is_cancelled)


def _several(request: ConformRequest, peer: CommandPeer | None) -> None:
    """Raise ArgumentError if there cannot be several peers at once. (P-KIT-JOBS)"""
    from koord.testing.conformance.holders import has_holder
    from koord.testing.conformance.peers import KNOWN

    if request.jobs < 1:
        raise ArgumentError("jobs", "it is 1 at least")
    if peer is None:
        raise ArgumentError("jobs", "there is one vehicle; checks side by side need a peer each")
    if request.peer not in KNOWN:
        holders = "{free} (a port), {domain} or {job} (a number)"
        if not has_holder(request.peer):
            raise ArgumentError(
                "jobs", f"all peers would be the same one; let its command have {holders}"
            )
        if not has_holder(dict(request.options or {})):
            raise ArgumentError(
                "jobs",
                f"all drivers would look for the same peer; let their options have {holders}",
            )


def subject_of(request: ConformRequest, job: int = 0) -> tuple[Subject, CommandPeer | None]:
    """What is tested, and the other side of its wire, for a job. Raises KoordError."""
    from koord.runtime.motion.bodies import VEHICLES
    from koord.testing.conformance.holders import fresh
    from koord.testing.conformance.peers import KNOWN, CommandPeer
    from koord.testing.conformance.subjects import Subject

    holders = fresh(job)
    known = KNOWN[request.peer].filled(holders) if request.peer in KNOWN else None
    driver = request.driver or (known.driver if known is not None else None)
    if driver is None:
        peers = ", ".join(KNOWN)
        raise ArgumentError("driver", f"say which, or a peer that koord has: {peers}")
    vehicle = request.vehicle or (known.vehicle if known is not None else _USUAL)
    if vehicle not in VEHICLES:
        raise ArgumentError("vehicle", f"there is no {vehicle}; there are {', '.join(VEHICLES)}")
    if not (math.isfinite(request.room_m) and request.room_m >= 2):
        raise ArgumentError("room", "the vehicle needs 2 m about it at least")
    given = {} if known is None else dict(known.options)
    given |= holders.value(dict(request.options or {}))
    virtual = driver == _SIMULATED if request.virtual_time is None else request.virtual_time
    peer: CommandPeer | None = None
    if known is not None:
        peer = CommandPeer(known.command, known.environment)
    elif request.peer is not None:
        peer = CommandPeer([holders.text(one) for one in _words(request.peer)])
    if virtual and peer is not None:
        raise ArgumentError("peer", "it is a process, and virtual time passes in this one alone")
    at_m = request.at_m or (known.at_m if known is not None else (0.0, 0.0, 0.0))
    subject = Subject(
        _target(driver),
        msgspec.json.encode(given),
        vehicle,
        at_m,
        known.heading_rad if known is not None else request.heading_rad,
        knows_start=known is not None or request.at_m is not None or virtual,
        room_m=request.room_m,
        arms=request.arm or peer is not None or virtual,
        is_virtual=virtual,
        name="" if ":" in driver else driver,
    )
    return subject, peer


def _can_be_made(driver: str, subject: Subject) -> None:
    """Raise KoordError for a driver that cannot be made of its options."""
    from koord.runtime.drivers.driver import DriverError

    try:
        made = subject.driver()
    except DriverError as error:
        raise refusal("K932", driver, error.message, error.hint) from None
    except KoordError:
        raise
    except Exception as error:
        story = f"its driver cannot be made: {type(error).__name__}: {error}"
        raise refusal("K932", driver, story, "a driver is called with its device") from None
    with suppress(Exception):  # it was never opened; what it holds already, it may let go
        made.close()


def read_options(path: str) -> dict[str, Any]:
    """Read the options of a driver from a file in YAML. Raises KoordError."""
    from koord.runtime.configuration.reading import read

    value: dict[str, Any] = read(source_of(path)).value
    return value


def _target(driver: str) -> str:
    """The module and object of a driver. Raises KoordError."""
    from koord.runtime.drivers.driver import DriverError

    try:
        registry().load(driver)
        return registry().target(driver)
    except DriverError as error:
        raise refusal("K932", driver, error.message, error.hint) from None


def _words(command: str) -> list[str]:
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise ArgumentError("peer", f"`{command}` is no command: {error}") from None
    if not words:
        raise ArgumentError("peer", "say a command, or the name of a peer that koord has")
    return words


def _known(only: Iterable[str], names: tuple[str, ...]) -> tuple[str, ...]:
    """The checks that are to be made, in their order. Raises ArgumentError."""
    wanted = tuple(only)
    for name in wanted:
        if name not in names:
            near = get_close_matches(name, names, n=1)
            cure = f"did you mean {near[0]}?" if near else f"there are {', '.join(names)}"
            raise ArgumentError("only", f"there is no check {name}; {cure}")
    return tuple(name for name in names if not wanted or name in wanted)
