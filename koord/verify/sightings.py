"""Events that were seen to run: a few random runs spare the solver its easiest questions."""

from __future__ import annotations

from random import Random

from koord.semantics.configurations import System
from koord.semantics.runs.policies import AtRandom, First, Play, Policy
from koord.semantics.runs.running import new_run
from koord.semantics.runs.watching import Watch
from koord.semantics.traces.trace import Numbers
from koord.syntax.diagnostics import KoordError
from koord.verify.solving import Deadline

#: Runs by chance, besides the one that the runtime would make.
RUNS = 3

Position = tuple[int, int]
"""An event: agent kind and position in its events."""


def seen_to_run(system: System, rounds: int, deadline: Deadline, seed: int) -> set[Position]:
    """Events that ran in one of a few runs of so many rounds. None of them need be proved to.

    Where the inputs of a run cannot be made up, or a run faults, it ends there.
    """
    seen: set[Position] = set()
    wanted = {
        (k, p) for k in set(system.kinds) for p in range(len(system.program.agents[k].events))
    }
    for number in range(RUNS + 1):
        rng = Random(seed + number)
        policy: Policy = First() if number == 0 else AtRandom(rng)
        run = new_run(system, Numbers.EXACT, rng)
        play = Play(run, policy, rounds, Watch(run.d, system, run.inputs))
        try:
            for taken in play.steps():
                step = taken.step
                if step.event is not None and step.robot is not None:
                    kind = system.kinds[step.robot]
                    state = step.configuration.robots[step.robot]
                    seen.add((kind, int(state.ran)))
                if seen == wanted or deadline.passed():
                    return seen
        except KoordError:
            continue
    return seen
