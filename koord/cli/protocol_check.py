"""``koord check-refinement --target protocol``: the round-commit protocol itself, in all
interleavings of three robots to a bound, and on simulated networks with every fault.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator

from msgspec import Struct

from koord.cli.exits import Exit
from koord.runtime.chaos.faults import CALM, CHAOS, LOSS, Faults
from koord.runtime.chaos.storm import Weathered, weather
from koord.runtime.exploration.exploring import Explored, explore
from koord.runtime.exploration.world import Bounds
from koord.runtime.protocol.setup import Setup, Timing

#: What is explored, and up to how many states each.
_CASES = {
    "one round": Bounds(rounds=1, epoch=0, crashes=0, eager=False),
    "two rounds": Bounds(rounds=2, epoch=0, crashes=0),
    "a crash and elections": Bounds(rounds=1, epoch=2, crashes=1, states=200_000),
    "a crash and a restart": Bounds(rounds=1, epoch=2, crashes=1, restarts=1, states=200_000),
}

NETWORKS = {"none": CALM, "loss": LOSS, "chaos": CHAOS}

#: How many robots are on the simulated networks, in turn.
_ROBOTS = (3, 4, 5, 7)


class Checked(Struct, frozen=True):
    """What was explored, and how the runs on simulated networks went."""

    explored: dict[str, Explored]
    runs: tuple[Weathered, ...]

    @property
    def broken(self) -> list[str]:
        """Every invariant that does not hold."""
        found = [
            f"{what}: {one.violation.broken.claim}: {one.violation.broken.story}"
            for what, one in self.explored.items()
            if one.violation is not None
        ]
        return found + [
            f"seed {run.seed}: {run.broken.claim}: {run.broken.story}"
            for run in self.runs
            if run.broken is not None
        ]


def main(arguments: argparse.Namespace) -> int:
    """Check, tell, and return the exit code."""
    faults = NETWORKS[arguments.faults]
    runs = tuple(_runs(arguments.runs, arguments.seed, faults))
    checked = Checked({what: explore(bounds) for what, bounds in _CASES.items()}, runs)
    if arguments.json:
        sys.stdout.write(json.dumps(_document(checked), indent=2) + "\n")
    else:
        _show(checked, arguments.faults)
    return Exit.VIOLATED if checked.broken else Exit.OK


def _runs(count: int, seed: int, faults: Faults) -> Iterator[Weathered]:
    for number in range(count):
        robots = _ROBOTS[number % len(_ROBOTS)]
        # Every fourth fleet has urgent events, so that rounds stay open for those who owe.
        owing = frozenset(range(robots)) if number % 4 == 3 else frozenset()
        setup = Setup(robots, Timing.of(0.1, robots), owing=owing)
        run = weather(setup, faults, seed + number)
        yield run
        if run.broken is not None:
            return


def _show(checked: Checked, network: str) -> None:
    for what, one in checked.explored.items():
        end = "all of them" if one.complete else f"to depth {one.depth}"
        print(f"{what}: {one.states:,} states, {one.transitions:,} transitions, {end}")
    rounds = sum(run.rounds for run in checked.runs)
    crashes = sum(run.crashes for run in checked.runs)
    late = sum(run.skips_late for run in checked.runs)
    print(
        f"{len(checked.runs)} runs on simulated networks ({network}): {rounds:,} rounds, "
        f"{late:,} late proposals, {crashes:,} crashes"
    )
    for one in checked.explored.values():
        if one.violation is not None:
            print("\n".join(f"  {line}" for line in one.violation.story))
    for story in checked.broken:
        print(f"broken: {story}")
    if not checked.broken:
        print("every invariant of specs/protocol held")


def _document(checked: Checked) -> dict[str, object]:
    return {
        "format": "koord-protocol-check",
        "version": 1,
        "explored": [
            {
                "what": what,
                "states": one.states,
                "transitions": one.transitions,
                "depth": one.depth,
                "complete": one.complete,
            }
            for what, one in checked.explored.items()
        ],
        "runs": len(checked.runs),
        "rounds": sum(run.rounds for run in checked.runs),
        "crashes": sum(run.crashes for run in checked.runs),
        "broken": checked.broken,
    }
