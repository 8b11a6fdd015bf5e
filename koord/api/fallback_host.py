"""The fallback host of simulated runs: starts, sensors and functions that no world answers.

They are found as for `koord run`: by chance, with the run's seed, such that assumptions, contracts
and summaries hold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from msgspec import Struct, field

from koord.refinement.sampling_hosts import SeededHost, settled_starts
from koord.runtime.compile.naming import PythonNames
from koord.runtime.platform.world_host import ANSWERED
from koord.runtime.ports import SIMULATED, plain_name, port_name
from koord.runtime.robot import Host, Key, Robot, Turn
from koord.syntax.system import System


class FallbackHost(Struct):
    """A host that answers at random the queries that another, the world, cannot."""

    world: Host
    system: System
    seed: int
    starts: Mapping[tuple[int | None, str], Any]
    served: Sequence[frozenset[str]]  #: the ports of each robot that plug-ins serve
    _seeded: dict[int, SeededHost] = field(default_factory=dict)
    _chance: str | None = None  #: what chance hangs on now, if no longer on the seed

    def start(self, robot: int | None, name: str) -> Any:
        found = self.starts.get((robot, name))
        return self.world.start(robot, name) if found is None else found

    def read(self, robot: Robot) -> Mapping[str, Any]:
        readings = dict(self.world.read(robot))
        served = self.served[robot.pid]
        unknown = [
            name
            for name in robot.SENSORS
            if port_name(name) not in SIMULATED and name not in served
        ]
        if unknown:
            drawn = self._of(robot.pid).read(robot)
            readings |= {name: drawn[name] for name in unknown}
        return readings

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        if plain_name(function) in ANSWERED:
            return self.world.ask(turn, robot, key, function, arguments)
        return self._of(robot).ask(turn, robot, key, function, arguments)

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        return self.world.choose(turn, robot, key, low, high)

    def reseed(self, seed: int) -> None:
        """Let what this host itself draws hang on another seed from now on."""
        self._chance = str(seed)
        for host in self._seeded.values():
            host.reseed(self._chance)

    def _of(self, pid: int) -> SeededHost:
        if pid not in self._seeded:
            names = PythonNames(self.system.program)
            self._seeded[pid] = SeededHost(self.system, names, str(self.seed), pid)
            if self._chance is not None:
                self._seeded[pid].reseed(self._chance)
        return self._seeded[pid]


def fallback(
    system: System, seed: int, *, starts: bool, served: Sequence[frozenset[str]]
) -> Callable[[Host], Host]:
    """Return what makes the fallback hosts of a run, which agree in all processes.

    With ``starts``, variables start as assumptions require. Raises KoordError where no such starts
    are found.
    """
    settled = settled_starts(system, PythonNames(system.program), seed) if starts else {}
    return partial(FallbackHost, system=system, seed=seed, starts=settled, served=served)
