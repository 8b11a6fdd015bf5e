"""Requests of ``koord verify``: its flags as data, and their consistency."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from fractions import Fraction
from typing import ClassVar

from msgspec import field

from koord.api.robots import FleetSize
from koord.api.verify import Engine, Options, engine_of
from koord.cli.files import DASH, check_writable
from koord.syntax.content import ByContent


class Request(ByContent, frozen=True):
    """The request for a verification of each program, with its limits."""

    ASIDE: ClassVar[frozenset[str]] = frozenset({"asked_at"})

    fleets: tuple[FleetSize, ...]  #: several make a sweep
    rounds: int
    delta_s: Fraction | None  #: None: as the program states
    engine: Engine
    properties: tuple[str, ...]  #: their names; none means all
    timeout_s: float | None  #: for everything together
    claim_s: float | None  #: the time for each property
    jobs: int
    violations: int  #: how many different ones of each claim
    seed: int
    trace: str | None  #: the file for the trace of a violation
    certificate: str | None  #: the file for what a proof consists of
    plot: str | None  #: the file for a picture of a sweep
    found: str | None  #: the file for invariants that were found
    rests_on: bool  #: find out what the proofs need
    instants: bool  #: ask of the time between the ends of rounds too
    explain: bool  #: show the steps that break claims which are not inductive
    as_json: bool
    #: when it was asked for, as :func:`time.monotonic` counts
    asked_at: float = field(default_factory=time.monotonic)

    def left_s(self) -> float | None:
        """The seconds left until the deadline; None: no limit."""
        return self.options.left_s

    @property
    def options(self) -> Options:
        """The options of the verification."""
        return Options(
            rounds=self.rounds,
            engine=self.engine,
            properties=self.properties,
            ends_at=None if self.timeout_s is None else self.asked_at + self.timeout_s,
            property_timeout_s=self.claim_s,
            jobs=self.jobs,
            max_violations=self.violations,
            seed=self.seed,
            instants=self.instants,
            rests_on=self.rests_on,
        )


def request_of(arguments: argparse.Namespace) -> Request:
    """Make the request. Raises ArgumentTypeError, before any work, if flags do not go together."""
    if arguments.output != DASH:
        raise argparse.ArgumentTypeError("-o says where --export writes to: add --export")
    request = _request(arguments)
    read = (*arguments.files, *arguments.properties)
    if request.trace is not None:
        if len(arguments.files) > 1:
            raise argparse.ArgumentTypeError("--trace takes one program at a time")
        if len(request.fleets) > 1:
            raise argparse.ArgumentTypeError("--trace takes one number of robots at a time")
        check_writable(request.trace, read)
    if request.certificate is not None:
        if len(arguments.files) > 1 or len(request.fleets) > 1 or request.fleets[0].any_number:
            raise argparse.ArgumentTypeError(
                "--certificate takes one program and one number of robots"
            )
        check_writable(request.certificate, read)
    if request.plot is not None:
        _check_plot(arguments.files, request, read)
    if request.found is not None:
        if len(arguments.files) > 1 or len(request.fleets) > 1:
            raise argparse.ArgumentTypeError("--save-invariants takes one program at a time")
        check_writable(request.found, read)
    if request.rests_on and len(request.fleets) > 1:
        raise argparse.ArgumentTypeError("--rests-on takes one number of robots at a time")
    engine_of(request.engine, every_n=request.fleets[0].any_number)
    return request


def _request(arguments: argparse.Namespace) -> Request:
    return Request(
        fleets=arguments.robots,
        rounds=arguments.rounds,
        delta_s=arguments.delta,
        engine=Engine(arguments.engine),
        properties=tuple(arguments.names),
        timeout_s=arguments.timeout,
        claim_s=arguments.claim_s,
        jobs=arguments.jobs,
        violations=arguments.violations,
        seed=arguments.seed,
        trace=arguments.trace,
        certificate=arguments.certificate,
        plot=arguments.plot,
        found=arguments.found,
        rests_on=arguments.rests_on,
        instants=arguments.instants,
        explain=arguments.explain,
        as_json=arguments.json,
    )


def _check_plot(files: Sequence[str], request: Request, read: Sequence[str]) -> None:
    from koord.api.pictures import check_drawable

    assert request.plot is not None
    if len(files) > 1 or len(request.fleets) == 1:
        raise argparse.ArgumentTypeError("--plot takes one program and a sweep: --robots 2..10")
    check_drawable(request.plot)
    check_writable(request.plot, read)
