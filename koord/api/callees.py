"""Who is told an order: the robots of this machine, and those of a configuration elsewhere."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from os import PathLike
from pathlib import Path
from typing import TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from koord.api.files import file_name, read_program
from koord.api.results import ArgumentError
from koord.runtime.orders.lines import robots_of
from koord.runtime.orders.places import Access, Running, found
from koord.runtime.wire.frames import order_key
from koord.syntax.diagnostics import Diagnostic, KoordError, refusal

#: The file of a configuration; None: all that runs on this machine.
Where: TypeAlias = str | PathLike[str] | None


class FleetFiles(Struct, frozen=True):
    """The files that say which robots are meant."""

    config: str | None  #: None: all that runs on this machine
    site: str | None  #: what the configuration does not say (P-SITE)

    @staticmethod
    def of(config: Where, site: Where) -> FleetFiles:
        """Take the arguments of an API function. Raises ArgumentError."""
        if site is not None and config is None:
            raise ArgumentError("site", "it adds to a configuration: say which")
        return FleetFiles(file_name(config), file_name(site))


class Callees(Struct, frozen=True):
    """Robots that are reached in one way. Those that are ``gone`` need not answer."""

    name: str
    access: Access
    pids: tuple[int, ...]
    file: Path | None = None  #: of a run of this machine
    is_gone: bool = False


def callees(
    files: FleetFiles, robots: Collection[int] | None, *, is_patient: bool = False
) -> tuple[list[Callees], tuple[Diagnostic, ...]]:
    """The robots that are meant. Raises KoordError if there are none, or none can be reached."""
    name = files.config
    fleets = [_here(path, run) for path, run in found(name)]
    warnings: tuple[Diagnostic, ...] = ()
    if name is not None and not any(_is_all(one) for one in fleets):
        covered = {pid for one in fleets if not one.is_gone for pid in one.pids}
        try:
            is_alone = not fleets and not is_patient
            fleets += _configured(name, files.site, covered, is_alone=is_alone)
        except KoordError as error:
            if not fleets:
                raise
            warnings = error.diagnostics  # those of this machine are called all the same
    elif name is None and not fleets and not is_patient:
        story = "nobody has deployed robots on this machine, as far as this user can see"
        hint = "say the configuration of robots that are elsewhere: `koord estop CONFIG`"
        raise refusal("K932", "koord estop", story, hint)
    if robots is not None and fleets:
        known = {pid for one in fleets for pid in one.pids}
        if unknown := sorted(set(robots) - known):
            story = f"there is no robot {unknown[0]}: there are {_spans(known)}"
            raise ArgumentError("robots", story)
        fleets = [_of(one, robots) for one in fleets]
    return [one for one in fleets if one.pids], warnings


def _is_all(fleet: Callees) -> bool:
    return fleet.access.is_whole and not fleet.is_gone


def _spans(pids: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(pids)))


def _of(fleet: Callees, robots: Collection[int]) -> Callees:
    return replace(fleet, pids=tuple(pid for pid in fleet.pids if pid in robots))


def _here(path: Path, run: Running) -> Callees:
    """The robots of a process of this machine. (O-HERE)"""
    pids = robots_of(run.access.reach)
    return Callees(run.configuration, run.access, pids, path, not run.is_alive)


def _configured(
    name: str, site: str | None, covered: Collection[int], *, is_alone: bool
) -> list[Callees]:
    """The robots of a configuration, wherever they are, but for those that are found already.

    Raises KoordError.
    """
    # An e-stop of robots of this machine does not wait until all this is imported.
    from koord.runtime.configuration.checking import load
    from koord.runtime.configuration.keys import shared_key
    from koord.runtime.orders.reach import reach_of

    more = None if site is None else read_program(site).source
    configuration = load(read_program(name).source, more)
    pids = tuple(robot.pid for robot in configuration.robots if robot.pid not in covered)
    key = shared_key(configuration) if pids else None
    if key is None:
        if pids and is_alone:
            story = "no robots of this configuration run on this machine, and it has no key"
            hint = "name the key by which others are reached: network: {key_file: …}, or KOORD_KEY"
            raise refusal("K932", configuration.name, story, hint)
        return []
    access = Access(order_key(key.key), configuration.talk.encrypts, reach_of(configuration, pids))
    return [Callees(configuration.name, access, pids)]
