"""What is installed to drive and to locate vehicles, by name: koord's own, and others'.

A package has a driver by an entry point of the group ``koord.drivers``, which names what makes it
(:class:`koord.runtime.drivers.driver.DriverType`), and a localiser by one of ``koord.localisers``
(:class:`koord.runtime.drivers.localiser.LocaliserType`).
"""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, ClassVar, Generic, Protocol, TypeVar, cast

import msgspec
from msgspec import Struct

from koord.runtime.drivers.driver import DriverError, DriverType
from koord.runtime.drivers.localiser import LocaliserType
from koord.runtime.motion.libraries import SIM
from koord.runtime.motion.libraries import missing as missing_library
from koord.syntax.diagnostics import KoordError

if TYPE_CHECKING:  # what these need, configurations are read without
    from koord.runtime.plugins.control import OwnControllerType
    from koord.runtime.plugins.modules import OwnModuleType
    from koord.runtime.plugins.planning import OwnPlannerType


class Optioned(Protocol):
    """What has options in configurations."""

    OPTIONS: ClassVar[type[Struct]]


Made = TypeVar("Made", bound=Optioned)


class Group(Struct, Generic[Made], frozen=True):
    """A group of entry points, and what one of it is called. ``Made``: what entries name."""

    name: str
    noun: str
    own: tuple[tuple[str, str], ...] = ()  #: koord's own plug-ins, and where they are


DRIVERS = Group[DriverType]("koord.drivers", "driver")
LOCALISERS = Group[LocaliserType]("koord.localisers", "localiser")
PLANNERS: Group[OwnPlannerType] = Group("koord.planners", "planner")
CONTROLLERS: Group[OwnControllerType] = Group(
    "koord.controllers",
    "controller",
    (("barrier", "koord.runtime.motion.certificates:BarrierCertificates"),),
)
MODULES: Group[OwnModuleType] = Group("koord.modules", "module")


class DriverEntry(Struct, frozen=True):
    """A driver or localiser that is installed, or of which something is missing."""

    name: str
    package: str  #: that has it, with its version
    target: str  #: the module and the object in it
    options: tuple[str, ...] = ()
    missing: str | None = None  #: why it cannot be loaded


class Registry(Generic[Made]):
    """The entries of a group by name; ``own`` are koord's, as module and object."""

    def __init__(self, group: Group[Made], own: Mapping[str, str], version: str) -> None:
        self.group = group
        self._own, self._version = own, version

    @cached_property
    def _found(self) -> dict[str, list[tuple[str, EntryPoint]]]:
        """The packages and their entry points by name, looked for when one is asked for."""
        found: dict[str, list[tuple[str, EntryPoint]]] = {}
        for name, target in self._own.items():
            found[name] = [(f"koord {self._version}", EntryPoint(name, target, self.group.name))]
        for one in entry_points(group=self.group.name):
            if one.value not in self._own.values():
                package = "?" if one.dist is None else f"{one.dist.name} {one.dist.version}"
                found.setdefault(one.name, []).append((package, one))
        return found

    @property
    def names(self) -> list[str]:
        return sorted(self._found)

    def entries(self) -> list[DriverEntry]:
        """All of them, each loaded to see whether it can be."""
        made = []
        for name in self.names:
            for package, entry in self._found[name]:
                options, missing = tuple[str, ...](), None
                try:
                    options = entry.load().OPTIONS.__struct_fields__
                except KoordError as error:
                    missing = _told(error)
                except Exception as error:  # whatever somebody else's module does
                    missing = f"{type(error).__name__}: {error}"
                    if isinstance(error, ModuleNotFoundError) and error.name in SIM:
                        missing = _told(missing_library(error.name, "sim"))
                made.append(DriverEntry(name, package, entry.value, options, missing))
        return made

    def load(self, name: str) -> Made:
        """What makes those of a name, or what stands at ``module:object``. Raises DriverError."""
        package, entry = self._entry(name)
        whose = f"the {self.group.noun} {name}" + (f" of {package}" if package else "")
        try:
            made = entry.load()
        except (ImportError, AttributeError) as error:
            cure = "install what is missing" if package else "say a module and an object in it"
            if not package and isinstance(error, ModuleNotFoundError):
                cure = "install the package that has it, or say in PYTHONPATH where it is"
            raise DriverError(f"{whose} cannot be loaded: {error}", cure) from error
        if not callable(made) or not hasattr(made, "OPTIONS"):
            raise DriverError(f"{whose} makes none", "it has to be callable, and to have OPTIONS")
        return cast(Made, made)

    def target(self, name: str) -> str:
        """The module and the object of a name, as ``module:object``. Raises DriverError."""
        _, entry = self._entry(name)
        return entry.value

    def _entry(self, name: str) -> tuple[str, EntryPoint]:
        """The package and the entry point of a name; no package if it says where it stands."""
        found, noun = self._found.get(name, []), self.group.noun
        if ":" in name and not found:
            return "", EntryPoint(name, name, self.group.name)
        if not found:
            near = get_close_matches(name, self.names, n=1)
            known = f"did you mean {near[0]}?" if near else f"there are: {', '.join(self.names)}"
            raise DriverError(f"there is no {noun} {name}", known)
        if len(found) > 1:
            packages = " and ".join(package for package, _ in found)
            raise DriverError(f"{packages} both have a {noun} {name}", "remove one of them")
        (one,) = found
        return one


def options_of(made: Optioned, given: bytes) -> Struct:
    """Its options, from JSON. Raises DriverError for those that it does not know."""
    try:
        options: Struct = msgspec.json.decode(given, type=made.OPTIONS, strict=False)
    except msgspec.ValidationError as error:
        known = ", ".join(made.OPTIONS.__struct_fields__) or "none"
        raise DriverError(str(error), f"its options are: {known}") from None
    return options


def _told(error: KoordError) -> str:
    """The first diagnostic of an error in one line."""
    (told, *_) = error.diagnostics
    return told.message if told.hint is None else f"{told.message}; {told.hint}"
