"""The setup of a deployment: a program and a configuration as the run that all robots know."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from koord.api.configurations import check_start
from koord.api.deploy_request import DeployRequest
from koord.api.drivers import localiser_registry, registry
from koord.api.fitting import Fitted, is_placed, slack_of
from koord.api.undriven import Drivers, drivers_of, led_together, undriven, unserved
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.compile.watching import watched
from koord.runtime.configuration.keys import SharedKey, shared_key
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.deploy.ideal import unanswered
from koord.runtime.deploy.job import Job as Job
from koord.runtime.deploy.job import print_of
from koord.runtime.deploy.member import Platform
from koord.runtime.encoding import text_digest
from koord.runtime.motion.libraries import SIM, require
from koord.runtime.ports import plain_name
from koord.runtime.protocol.handshake import Fingerprint
from koord.runtime.robot import Robot
from koord.syntax import core
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity, refusal
from koord.syntax.source import whole_file
from koord.syntax.system import System


def job_of(fitted: Fitted, request: DeployRequest) -> Job:
    """The run as its robots know it. Raises KoordError."""
    robots = len(fitted.kinds)
    if request.pid is not None and not 0 <= request.pid < robots:
        story, hint = f"there is no robot {request.pid}", f"the pids are 0 to {robots - 1}"
        raise refusal("K932", fitted.configuration.name, story, hint)
    check_start(fitted)
    configuration, classes = fitted.configuration, loaded(compiled(fitted.program.core))
    assert configuration.delta_s is not None
    key = _key(configuration, request)
    missing: tuple[Diagnostic, ...] = tuple(led_together(fitted))
    drivers = Drivers()
    if not request.dry_run:
        drivers, found = drivers_of(configuration, registry(), localiser_registry())
        found += undriven(fitted)
        found += unserved(fitted, drivers, request.allow_models)
        missing += (*found, *_unanswered(fitted, classes, drivers))
    if request.as_fast_as_possible and (request.dry_run or drivers.made):
        missing += (_hurried(configuration),)
    if key is None:
        missing += (keyless(configuration),)
    if key is None or missing:
        raise KoordError(missing)
    if configuration.talk.encrypts:
        require(("cryptography",), "encrypt")
    run = request.run or configuration.talk.run
    is_exact = not request.dry_run and not drivers.made
    return Job(
        classes,
        fitted.kinds,
        configuration,
        key.key,
        run,
        delta_s=configuration.delta_s,
        pace_s=0.0 if request.as_fast_as_possible else configuration.delta_s,
        rounds=request.rounds,
        journals=None,
        starts=_starts(fitted),
        program=_program(fitted.program.core),
        insists=request.fresh,
        key_print="" if request.pid is None else print_of(key.key, run),
        warnings=key.warnings,
        is_local=request.pid is None,
        waits=request.preflight or (request.arm and bool(drivers.made)),
        platforms=_platforms(fitted, drivers, request),
        watched=watched(fitted.program.core, slack_of(fitted, is_exact=is_exact)),
    )


def _platforms(
    fitted: Fitted, drivers: Drivers, request: DeployRequest
) -> Callable[[Job, int], Platform] | None:
    """The platforms of vehicles; None: all robots are ideal points. Raises KoordError."""
    if not request.dry_run and not drivers.made:
        return None
    require(SIM, "sim")
    from koord.api.platforms import platforms, simulated

    if request.dry_run:
        return simulated(fitted)
    return platforms(fitted, drivers, arms=request.arm)


def _starts(fitted: Fitted) -> Mapping[tuple[int | None, str], Any]:
    """Starts as the program assumes them, equal for all robots; where they are is configured.

    Raises KoordError where there are none.
    """
    program = fitted.program.core
    if not program.assumptions or is_placed(program):
        return {}
    from koord.refinement.sampling_hosts import settled_starts
    from koord.runtime.compile.naming import PythonNames

    system = System(program, fitted.kinds, fitted.delta_s)
    return settled_starts(system, PythonNames(program), fitted.configuration.seed)


def _program(program: core.Program) -> Fingerprint:
    """What robots run, as all have to, whatever its file is called and however it is laid out."""
    parts = (
        program.agents,
        program.allread,
        program.allwrite,
        program.functions,
        program.externals,
        program.lock_classes,
    )
    # Nodes show what they mean, and not where they stand.
    params = tuple((f"param {one.name}", str(one.value)) for one in program.parameters)
    return (("program", text_digest(repr(parts), 8)), *params)


def _unanswered(
    fitted: Fitted, classes: tuple[type[Robot], ...], drivers: Drivers
) -> Iterator[Diagnostic]:
    """Yield the functions that no library answers."""
    answered = _library() if drivers.made else frozenset[str]()
    missing: set[str] = set()
    for pid, kind in enumerate(fitted.kinds):
        functions = classes[kind].EXTERNALS
        if pid in drivers.made:
            missing |= {name for name in functions if plain_name(name) not in answered}
        else:
            missing |= set(unanswered(functions))
    if missing:
        who = "robots" if drivers.made else "robots without a platform"
        story = f"{who} have no {', '.join(sorted(missing))}"
        hint = "write these functions in Koord, with a body"
        place = whole_file(fitted.configuration.name)
        yield Diagnostic("K932", Severity.ERROR, place, story, hint)


def _library() -> frozenset[str]:
    """The functions that robots on vehicles answer. Raises KoordError."""
    require(SIM, "sim")
    from koord.runtime.platform.world_host import ANSWERED

    return ANSWERED


def _key(configuration: RunConfiguration, request: DeployRequest) -> SharedKey | None:
    """The key of a run; None if robots that are to have one have none. Raises KoordError."""
    if request.pid is None:  # on one machine nobody else needs to know the key
        return SharedKey(secrets.token_bytes(32))
    return shared_key(configuration)


def _hurried(configuration: RunConfiguration) -> Diagnostic:
    story = "vehicles take their time, and rounds are to be as fast as possible"
    hint = "let rounds have their length"
    return Diagnostic("K932", Severity.ERROR, whole_file(configuration.name), story, hint)


def keyless(configuration: RunConfiguration) -> Diagnostic:
    """The diagnostic of robots on several computers that have no key. (K932)"""
    story = "the robots have no key in common"
    hint = (
        "write one with `koord config key robots.key`, and add network: {key_file: robots.key}, "
        "here or in the file of a site (`site=`)"
    )
    return Diagnostic("K932", Severity.ERROR, whole_file(configuration.name), story, hint)
