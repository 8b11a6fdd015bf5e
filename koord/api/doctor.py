"""What is installed of all that koord can use, what is missing, and what that would give."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from collections.abc import Iterable
from importlib import import_module
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as version_of
from typing import TYPE_CHECKING

from msgspec import Struct, to_builtins

from koord.api.cache import Cache, usual_folder
from koord.api.drivers import DriverEntry, installed_drivers, installed_localisers
from koord.api.progress import cores
from koord.api.results import ArgumentError, Result, html_table
from koord.version import __version__

if TYPE_CHECKING:
    from koord.api import forms


class Extra(Struct, frozen=True):
    """An extra of koord's package: ``pip install 'koord[NAME]'`` brings its packages."""

    name: str
    gives: str
    packages: tuple[str, ...]


#: All but those for who works on koord itself.
EXTRAS = (
    Extra("cluster", "verifications and campaigns on a Dask cluster", ("distributed",)),
    Extra("completion", "scripts of shells that complete commands", ("shtab",)),
    Extra("crazyflie", "the driver of Crazyflies", ("cflib",)),
    Extra("encrypt", "datagrams of robots that nobody else can read", ("cryptography",)),
    Extra("export", "runs for Rerun and for ROS 2 tools", ("rerun-sdk", "rosbags")),
    Extra("fast", "machine code for searches, long runs and control", ("llvmlite",)),
    Extra("gps", "the localiser of GPS receivers", ("pymap3d", "pynmea2")),
    Extra("lsp", "the language server that editors start (`koord lsp`)", ("pygls",)),
    Extra("mavlink", "the driver of PX4 and ArduPilot", ("pymavlink",)),
    Extra("motioncapture", "localisers of motion capture systems", ("motioncapture", "numpy")),
    Extra("mujoco", "vehicles with wheels, tyres and rotors", ("mujoco-core",)),
    Extra("natnet", "the localiser of OptiTrack", ("natnet",)),
    Extra("parquet", "campaigns as tables for data frames", ("pyarrow",)),
    Extra("plot", "plots of runs and of campaigns", ("matplotlib",)),
    Extra("recheck", "a second solver for certificates", ("cvc5",)),
    Extra("record", "recordings of deployed runs", ("mcap",)),
    Extra("robotarium", "the driver of the Robotarium", ("robotarium-python-simulator",)),
    Extra("ros2", "the driver of ROS 2 vehicles", ("cyclonedds",)),
    Extra("sim", "simulated worlds", ("mcap", "numpy", "ompl", "pymunk", "scipy", "shapely")),
    Extra("ssh", "fleets that one command starts", ("asyncssh",)),
    Extra("view", "pages that show robots in space", ("viser",)),
    Extra("zenoh", "a routed network for fleets across sites", ("eclipse-zenoh",)),
)

#: What koord cannot do without: packages, and the module of each that has to be loaded.
NEEDED = {
    "lark": "lark",
    "msgspec": "msgspec",
    "pygments": "pygments",
    "python-sat": "pysat.solvers",
    "pyyaml": "yaml",
    "rich": "rich",
    "z3-solver": "z3",
}


class OtherTool(Struct, frozen=True):
    """A program of others: names that it may have, what it gives, and Debian's package of it."""

    name: str
    commands: tuple[str, ...]
    gives: str
    package: str


TOOLS = (
    OtherTool(
        "abc",
        ("berkeley-abc", "abc"),
        "more proofs, bit by bit (the engine abc)",
        "berkeley-abc",
    ),
    OtherTool("yosys", ("yosys",), "reads problems that are exported as AIGER", "yosys"),
    OtherTool("java", ("java",), "runs TLC on problems that are exported as TLA+", "default-jre"),
    OtherTool("ssh", ("ssh",), "keys and hosts of fleets over SSH", "openssh-client"),
    OtherTool("spin", ("spin",), "a peer in koord's own tests", "spin"),
    OtherTool("cc", ("cc", "gcc", "clang"), "compiles what SPIN makes, in koord's tests", "gcc"),
    OtherTool(
        "chromium",
        ("chromium", "chromium-browser", "google-chrome"),
        "shows pages in koord's own tests",
        "chromium",
    ),
)


class FoundPackage(Struct, frozen=True):
    """A package that koord needs or can use; ``trouble`` says why it cannot be loaded."""

    name: str
    version: str | None  #: None: it is not installed
    trouble: str | None = None


class FoundExtra(Struct, frozen=True):
    """An extra, with its packages."""

    name: str
    gives: str
    packages: tuple[FoundPackage, ...]

    @property
    def missing(self) -> tuple[str, ...]:
        """Its packages that are not installed."""
        return tuple(one.name for one in self.packages if one.version is None)

    @property
    def cure(self) -> str:
        """The command that installs it."""
        return f"pip install 'koord[{self.name}]'"


class FoundTool(Struct, frozen=True):
    """A program of others, with its path; None: it is not installed."""

    name: str
    path: str | None
    gives: str
    package: str

    @property
    def cure(self) -> str:
        """How it is installed, on Debian."""
        return f"apt-get install {self.package}"


class CacheState(Struct, frozen=True):
    """The folder of kept verdicts, and how much is in it."""

    folder: str
    entries: int
    size_bytes: int
    is_writable: bool


class Doctor(Result, frozen=True):
    """What is installed here."""

    python: str
    executable: str
    system: str  #: the operating system and the processor
    cores: int  #: that this process may use
    needed: tuple[FoundPackage, ...]
    extras: tuple[FoundExtra, ...]
    tools: tuple[FoundTool, ...]
    drivers: tuple[DriverEntry, ...]
    localisers: tuple[DriverEntry, ...]
    cache: CacheState
    wanted: tuple[str, ...] = ()  #: what was asked for by name

    @property
    def problems(self) -> tuple[str, ...]:
        """What is wrong: what koord needs, or was asked for, and is not there."""
        found = []
        for one in self.needed:
            if one.version is None:
                found.append(f"{one.name} is not installed: pip install {one.name}")
            elif one.trouble is not None:
                cure = f"remove it and install it again: pip install {one.name}"
                found.append(f"{one.name} cannot be loaded: {one.trouble}; {cure}")
        absent = [(one.name, one.cure) for one in self.extras if one.missing]
        absent += [(one.name, one.cure) for one in self.tools if one.path is None]
        found += [
            f"{name} is wanted and missing: {cure}" for name, cure in absent if name in self.wanted
        ]
        if not self.cache.is_writable:
            found.append(f"{self.cache.folder} cannot be written: KOORD_CACHE names another folder")
        return tuple(found)

    @property
    def ok(self) -> bool:
        """True if nothing that koord needs, or that was asked for, is missing."""
        return not self.problems

    def form(self) -> forms.Doctor:
        """The result as JSON has it."""
        from koord.api import forms

        def packages(found: Iterable[FoundPackage]) -> list[forms.Package]:
            return [forms.Package(one.name, one.version, one.trouble) for one in found]

        def entries(found: Iterable[DriverEntry]) -> list[forms.PlugIn]:
            return [forms.PlugIn(one.name, one.package, one.missing) for one in found]

        return forms.Doctor(
            format="koord-doctor",
            version=1,
            koord=__version__,
            python=self.python,
            executable=self.executable,
            system=self.system,
            cores=self.cores,
            ok=self.ok,
            problems=list(self.problems),
            needed=packages(self.needed),
            extras=[
                forms.ExtraState(one.name, one.gives, not one.missing, packages(one.packages))
                for one in self.extras
            ],
            tools=[
                forms.ToolState(one.name, one.path, one.gives, one.package) for one in self.tools
            ],
            drivers=entries(self.drivers),
            localisers=entries(self.localisers),
            cache=forms.CacheState(
                self.cache.folder,
                self.cache.entries,
                self.cache.size_bytes,
                self.cache.is_writable,
            ),
        )

    def to_dict(self) -> dict[str, object]:
        """As ``koord doctor --json`` prints it."""
        found: dict[str, object] = to_builtins(self.form())
        return found

    def __repr__(self) -> str:
        there = [one.name for one in self.extras if not one.missing]
        lines = "".join(f"\n  {problem}" for problem in self.problems)
        said = f"extras: {', '.join(there) or 'none'}"
        return f"<Doctor koord {__version__}, Python {self.python}, {said}>{lines}"

    def _repr_html_(self) -> str:
        rows = [
            (one.name, one.gives, f"install it: {one.cure}" if one.missing else "installed")
            for one in self.extras
        ]
        rows += [(one.name, one.gives, one.path or f"install it: {one.cure}") for one in self.tools]
        heading = f"koord {__version__}, Python {self.python}, {self.system}"
        return html_table("; ".join([heading, *self.problems]), ("", "gives", ""), rows)


def doctor(*wanted: str) -> Doctor:
    """Look at what is installed here; nothing is changed.

    ``wanted`` are names of extras and tools that have to be there: where one is missing, that is
    among the ``problems``. Raises :class:`koord.ArgumentError` for a name that there is not.

    >>> koord.doctor().ok
    True
    """
    known = [*(one.name for one in EXTRAS), *(one.name for one in TOOLS)]
    for name in wanted:
        if name not in known:
            raise ArgumentError("wanted", f"there is no {name!r}; there are {', '.join(known)}")
    return Doctor(
        python=f"{platform.python_version()} ({platform.python_implementation()})",
        executable=sys.executable,
        system=f"{platform.system()} {platform.release()}, {platform.machine()}",
        cores=cores(),
        needed=tuple(_package(name, module) for name, module in NEEDED.items()),
        extras=tuple(
            FoundExtra(one.name, one.gives, tuple(map(_package, one.packages))) for one in EXTRAS
        ),
        tools=tuple(
            FoundTool(one.name, _path(one.commands), one.gives, one.package) for one in TOOLS
        ),
        drivers=installed_drivers(),
        localisers=installed_localisers(),
        cache=_cache(),
        wanted=wanted,
    )


def _package(name: str, module: str | None = None) -> FoundPackage:
    """A package; one with a ``module`` is loaded, to see whether it can be."""
    try:
        version = version_of(name)
    except PackageNotFoundError:
        version = None
    if module is None:
        return FoundPackage(name, version)
    try:
        import_module(module)
    except Exception as error:  # a library of another machine fails in its own way
        return FoundPackage(name, version, f"{type(error).__name__}: {error}")
    return FoundPackage(name, version or "of unknown version")


def _path(commands: tuple[str, ...]) -> str | None:
    return next(filter(None, map(shutil.which, commands)), None)


def _cache() -> CacheState:
    folder = usual_folder()
    use = Cache(folder).use()
    return CacheState(folder, use.entries, use.size, _is_writable(folder))


def _is_writable(folder: str) -> bool:
    """Return whether a folder can be written to, or made where it is not there yet."""
    while not os.path.lexists(folder) and os.path.dirname(folder) != folder:
        folder = os.path.dirname(folder)
    return os.path.isdir(folder) and os.access(folder, os.W_OK | os.X_OK)
