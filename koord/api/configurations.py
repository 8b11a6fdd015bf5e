"""Checking of configurations, alone and with a program."""

from __future__ import annotations

from os import fspath

from msgspec import Struct
from msgspec.structs import replace

from koord.api.drivers import localiser_registry, registry
from koord.api.fitting import FitRequest, Fitted, beside, can_be_placed, fit
from koord.api.programs import Loadable, Program, Text, source_of
from koord.api.results import Result, diagnostics_dict
from koord.api.undriven import drivers_of
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.configuration.gazebo import read_world, told_as_yaml
from koord.runtime.configuration.gazebo_files import finder
from koord.runtime.configuration.keys import new_key as new_key
from koord.runtime.configuration.keys import write_key as write_key
from koord.runtime.configuration.model import RunConfiguration, params
from koord.runtime.configuration.scenes import in_scene, read_scene
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import Source, counted


class ConfigurationReport(Result, frozen=True):
    """The diagnostics of a configuration, by itself and for a program."""

    name: str
    configuration: RunConfiguration | None  #: None if it cannot be read
    program: str | None  #: the name of the program that it was checked with, if with any
    diagnostics: tuple[Diagnostic, ...]
    sources: tuple[Source, ...]  #: the texts that the diagnostics are about

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        """The errors, which prevent a run."""
        return tuple(d for d in self.diagnostics if d.severity is Severity.ERROR)

    @property
    def ok(self) -> bool:
        """True if robots can be run with it."""
        return not self.errors

    def to_dict(self) -> dict[str, object]:
        """The diagnostics as plain data, as ``koord config check --json`` prints them."""
        return diagnostics_dict(self.diagnostics)

    def summary(self) -> str:
        """The configuration in one line. It has to be readable."""
        assert self.configuration is not None
        robots = self.configuration.robots
        vehicles = sorted({robot.vehicle.type_name for robot in robots})
        count = f"{counted(len(robots), 'robot')} ({', '.join(vehicles)})"
        talk = self.configuration.talk
        shared = f" to {talk.shared}" if talk.shared is not None else ""
        shared += ", encrypted" if talk.encrypts else ""
        length = self.configuration.delta_s
        rounds = "as long as the program states" if length is None else f"of {length:g} s"
        return f"{count}, {talk.carrier.value}{shared}, rounds {rounds}"

    def __repr__(self) -> str:
        said = f"{len(self.errors)} errors" if self.configuration is None else self.summary()
        lines = [f"{d.span}: {d.severity.value} {d.code}: {d.message}" for d in self.diagnostics]
        return "\n".join([f"<ConfigurationReport {self.name}: {said}>", *lines])


def check_configuration(
    text: Text,
    program: Loadable | None = None,
    site: Text | None = None,
    scene: Text | None = None,
) -> ConfigurationReport:
    """Check a configuration, and a program with it; return all diagnostics.

    ``text`` is the name of a file, or a text, and so are ``site``, what the configuration does not
    say, and ``scene``, where robots begin (:func:`koord.read_configuration`). Without a program,
    the one beside the file counts, if there is one of its name. Mistakes are data: nothing is
    raised for them.

    >>> koord.check_configuration("task.yaml").errors
    ()
    """
    name = text.name if isinstance(text, Source) else fspath(text)
    if program is None and not isinstance(text, Source):
        program = beside(name, ".krd")
    configuration, sources, found = None, list[Source](), list[Diagnostic]()
    try:
        sources.append(source_of(text))
        if site is not None:
            sources.append(source_of(site))
        configuration = load_configuration(*sources)
        if scene is not None:
            sources.append(source_of(scene))
            configuration = in_scene(configuration, read_scene(sources[-1]))
        found += drivers_of(configuration, registry(), localiser_registry(), drives=False)[1]
        if program is None:
            found += configuration.warnings
            _check_alone(configuration)
        else:
            request = _request(program, configuration)
            sources.append(request.source)
            fitted = fit(request)
            found += fitted.warnings
            check_start(fitted)
    except KoordError as error:
        found += error.diagnostics
    called = None if program is None else _name(program)
    return ConfigurationReport(name, configuration, called, tuple(found), tuple(sources))


class WorldRead(Struct, frozen=True):
    """A world of Gazebo as the text of a site, and what of it is not taken."""

    text: str  #: YAML: a `world:` with its obstacles
    warnings: tuple[Diagnostic, ...]
    sources: tuple[Source, ...]


def world_of_gazebo(text: Text) -> WorldRead:
    """Read a world of Gazebo as the text of a site. Raises KoordError. (P-WORLD)"""
    source = source_of(text)
    read = read_world(source, finder(source.name))
    return WorldRead(told_as_yaml(read), read.warnings, read.sources)


def check_start(fitted: Fitted) -> None:
    """Check that a run may begin with program and configuration. Raises KoordError. (K934)

    Without the libraries that simulated worlds are made with, nobody can tell.
    """
    if fitted.placed is not None:
        from koord.api.sim_setup import check_can_begin

        check_can_begin(fitted)


def _request(program: Loadable, configuration: RunConfiguration) -> FitRequest:
    if isinstance(program, Program):
        given = dict(program.settings.params)
        return FitRequest(program.source, configuration, program.properties, given, located=True)
    return FitRequest(source_of(program), configuration, (), {}, located=True)


def _name(program: Loadable) -> str:
    return program.name if isinstance(program, Program | Source) else fspath(program)


def _check_alone(configuration: RunConfiguration) -> None:
    """Check a configuration without a program. Raises KoordError."""
    params(configuration)
    if can_be_placed():
        from koord.sim.scene import scene

        scene(replace(configuration, delta_s=configuration.delta_s or 1.0))
