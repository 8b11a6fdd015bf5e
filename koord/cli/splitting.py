"""``koord sim --splitting CLAIM``: how often runs break a claim, however rare that is."""

from __future__ import annotations

import argparse
import sys
from argparse import ArgumentTypeError
from collections.abc import Iterator

from msgspec.structs import replace

from koord.api.fitting import FitRequest
from koord.api.progress import Progress
from koord.api.splitting import (
    PARTICLES,
    REPETITIONS,
    Splitting,
    SplittingRequest,
    make_splitting,
)
from koord.cli.campaigns import OF_ONE_RUN
from koord.cli.exits import Exit
from koord.cli.progress import Interruption, LiveLine
from koord.cli.terminal import Paint, style_of, visible

#: The flags of campaigns, which say nothing to splitting.
_OF_CAMPAIGNS = ("plot", "sweep", "until", "csv", "parquet", "resume", "cluster", "check_summaries")

#: An interval of a mean is nearly right where so many repetitions found something.
_ENOUGH = 10


def splitting_request(arguments: argparse.Namespace) -> SplittingRequest:
    """Make the request. Raises ArgumentTypeError and KoordError, before long work."""
    for name in (*OF_ONE_RUN, *_OF_CAMPAIGNS):
        if getattr(arguments, name):
            flag = f"--{name.replace('_', '-')}"
            raise ArgumentTypeError(f"--splitting tells a rate alone: leave out {flag}")
    request = SplittingRequest(
        claim=arguments.splitting,
        level=arguments.level,
        particles=PARTICLES if arguments.particles is None else arguments.particles,
        runs=REPETITIONS if arguments.runs is None else arguments.runs,
        jobs=arguments.jobs,
        rounds=arguments.rounds,
        duration_s=arguments.time,
        kernels=arguments.kernels == "on",
    )
    request.check()
    return request


def splitting(
    arguments: argparse.Namespace, wanted: FitRequest, request: SplittingRequest, first_seed: int
) -> int:
    """Make the repetitions, report on them, and return the exit code. Raises KoordError."""
    with Interruption() as interruption, LiveLine(sys.stderr) as line:

        def show(told: Progress) -> None:
            line.show(told.message)

        made = make_splitting(replace(wanted, seed=first_seed), request, show, interruption)
    if arguments.json:
        sys.stdout.write(made.to_json() + "\n")
    else:
        for text in _lines(made):
            print(text)
    if made.interrupted:
        return Exit.INTERRUPTED
    return Exit.VIOLATED if made.found else Exit.OK


def _lines(made: Splitting) -> Iterator[str]:
    """The rate with its interval of 95 %, and how far it is to be trusted."""
    style, repetitions = style_of(sys.stdout), len(made.repetitions)
    heading = f"{made.program}: {made.claim}, {repetitions} repetitions of splitting with "
    yield style.paint(visible(f"{heading}{made.particles} particles"), Paint.BOLD)
    highest = made.highest
    above = "" if highest is None else f"; without a break the highest level is {highest:.4g}"
    yield f"  {made.runs} runs were made, also in part{above}"
    interval = made.interval
    if interval is None:
        yield "  interrupted: there is a rate of all repetitions alone"
    elif not made.found:
        first, most = made.particles * repetitions, f"{interval.high:.2g}"
        yield f"  no violation was found: at most {most} of runs break it (95 %), as the first"
        yield f"  {first} runs say, by chance; that none came higher later says no more: where"
        yield "  a level leads elsewhere, or stays as it is until the claim breaks, splitting finds"
        yield "  nothing; another --level, more --particles or a longer --time may find something"
    else:
        rate = style.paint(f"{interval.mean:.3g}", Paint.ERROR)
        low, high = f"{interval.low:.2g}", f"{interval.high:.2g}"
        yield f"  broken in {rate} of runs, 95 % interval {low} to {high}"
        if made.found < max(_ENOUGH, repetitions // 2):
            told = f"only {made.found} of {repetitions} repetitions found that"
            yield f"  {told}: the interval may be too narrow; more --particles, or more --runs"
