"""The check of the round-commit protocol itself: explorations, simulated networks, and a proof.

All interleavings of a few robots are explored to a bound, handshakes included; simulated networks
have every fault; the proof is for every number of robots.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from koord.api.progress import Cancellation, Listener, Progress, asker, heard_by
from koord.api.proofs import Proof, proved
from koord.api.refinement import NETWORKS, Network
from koord.api.results import ArgumentError, Result, html_table
from koord.runtime.chaos.network import Faults
from koord.runtime.chaos.storm import Weathered, weather
from koord.runtime.exploration.claims import InvariantViolation
from koord.runtime.exploration.exploring import Explored, explore
from koord.runtime.exploration.handshakes import (
    HandshakeBounds,
    HandshakeExplorer,
    HandshakesExplored,
)
from koord.runtime.exploration.world import Disk, ExplorationBounds
from koord.runtime.protocol.setup import Setup, Timing

#: What is explored, and up to how many states each.
_CASES: Mapping[str, ExplorationBounds | HandshakeBounds] = {
    "one round": ExplorationBounds(rounds=1, epoch=0, crashes=0, eager=False),
    "two rounds": ExplorationBounds(rounds=2, epoch=0, crashes=0),
    "a crash and elections": ExplorationBounds(rounds=1, epoch=2, crashes=1, states=200_000),
    "a crash and a restart": ExplorationBounds(
        rounds=1, epoch=2, crashes=1, restarts=1, states=200_000
    ),
    "an old disk": ExplorationBounds(
        rounds=1, epoch=2, crashes=1, restarts=1, disks=frozenset({Disk.OLD}), states=200_000
    ),
    "a robot twice": ExplorationBounds(rounds=1, epoch=2, crashes=0, twins=1, states=200_000),
    "handshakes": HandshakeBounds(robots=2, starts=3, other=True),
}

#: What is held against the model that is proved for every number of robots.
_HELD_AGAINST_MODEL = {
    "one round": ExplorationBounds(rounds=1, epoch=0, crashes=0, eager=False),
    "elections": ExplorationBounds(rounds=1, epoch=1, crashes=0, states=30_000),
    "crashes and returns": ExplorationBounds(
        rounds=1, epoch=2, crashes=1, restarts=1, twins=1, states=30_000
    ),
}

#: How many robots are on the simulated networks, in turn.
_ROBOTS = (3, 4, 5, 7)


class ProtocolCheck(Result, frozen=True):
    """The results of the explorations, and of the runs on simulated networks."""

    explored: Mapping[str, Explored | HandshakesExplored]
    runs: tuple[Weathered, ...]
    interrupted: bool = False

    @property
    def broken(self) -> list[str]:
        """The violated invariants."""
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

    @property
    def ok(self) -> bool:
        """True if everything was checked, and every invariant held."""
        return not self.broken and not self.interrupted

    def to_dict(self) -> dict[str, object]:
        """The result as plain data, as ``koord check-refinement --json`` prints it."""
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
                for what, one in self.explored.items()
            ],
            "runs": len(self.runs),
            "rounds": sum(run.rounds for run in self.runs),
            "crashes": sum(run.crashes for run in self.runs),
            "broken": self.broken,
        }

    def __repr__(self) -> str:
        states = sum(one.states for one in self.explored.values())
        said = "; ".join(self.broken) or "every invariant of specs/protocol held"
        return f"<ProtocolCheck {states:,} states, {len(self.runs)} runs: {said}>"

    def _repr_html_(self) -> str:
        rows = [(what, one.states, one.transitions) for what, one in self.explored.items()]
        return html_table(repr(self), ("what", "states", "transitions"), rows)


def check_protocol(
    *,
    runs: int = 100,
    seed: int = 0,
    faults: Network = "none",
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> ProtocolCheck:
    """Check the round-commit protocol, by exploration and by runs on bad networks.

    All interleavings are explored to a bound, and ``runs`` made on networks with ``faults``. Every
    random choice depends on the ``seed`` only.

    Raises :class:`koord.ArgumentError` for faults that there are not.
    """
    if faults not in NETWORKS:
        raise ArgumentError("faults", f"{faults!r} is none of {', '.join(NETWORKS)}")
    tell, is_cancelled = heard_by(progress), asker(cancellation)
    weathered: list[Weathered] = []
    explored: dict[str, Explored | HandshakesExplored] = {}
    for run in _runs(runs, seed, NETWORKS[faults]):
        weathered.append(run)
        tell(Progress(f"{len(weathered)} of {runs} runs"))
        if is_cancelled():
            break
    for what, bounds in _CASES.items():
        if is_cancelled():
            break
        tell(Progress(what))
        match bounds:
            case ExplorationBounds():
                explored[what] = explore(bounds)
            case HandshakeBounds():
                explored[what] = HandshakeExplorer(bounds).run()
    return ProtocolCheck(explored, tuple(weathered), is_cancelled())


class ProtocolProof(Proof, frozen=True):
    """The proof that the protocol is safe for every number of robots.

    ``steps`` are those of the proof on the model; ``explored``: where the machine was held against
    the model.
    """

    @property
    def strays(self) -> tuple[InvariantViolation, ...]:
        """What the machine does and the model does not."""
        return self.violations

    @property
    def invariants(self) -> tuple[str, ...]:
        """The ids of the invariants of specs/protocol that were proved."""
        if self.open:
            return ()
        return tuple(step.statement for step in self.steps if step.statement.startswith("I-"))

    def to_dict(self) -> dict[str, object]:
        """The result as plain data, as ``koord check-refinement --json`` prints it."""
        return {
            "format": "koord-protocol-proof",
            "version": 1,
            "proved": self.ok,
            "invariants": list(self.invariants),
            "explored": [
                {"what": what, "states": one.states, "transitions": one.transitions}
                for what, one in self.explored.items()
            ],
            "strays": [one.broken.story for one in self.strays],
            "steps": [
                {
                    "action": step.action,
                    "rule": step.rule,
                    "statement": step.statement,
                    "answer": step.answer.value,
                    "seconds": round(step.seconds, 3),
                    "counterexample": list(step.counterexample),
                }
                for step in self.steps
            ],
        }

    def __repr__(self) -> str:
        said = "; ".join(f"{one.action or 'claims'}: {one.statement}" for one in self.open)
        return f"<ProtocolProof {len(self.steps)} steps: {said or 'all proved'}>"

    def _repr_html_(self) -> str:
        rows = [(one.action, one.statement, one.answer.value) for one in self.steps]
        return html_table(repr(self), ("action", "statement", "answer"), rows)


def prove_protocol(
    *,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> ProtocolProof:
    """Prove the protocol safe for every number of robots, rounds, epochs, crashes and returns.

    Z3 is asked whether each action of a model in first-order logic keeps each statement of an
    inductive invariant, and whether the invariants of specs/protocol follow from it. Then some
    explorations of the machine are held against the model, state by state and step by step.
    """
    from koord.refinement.protocol_proof.correspondence import held_against_model
    from koord.refinement.protocol_proof.proving import Prover

    tell, is_cancelled = heard_by(progress), asker(cancellation)
    explored = {}
    steps = proved(Prover().steps(), tell, is_cancelled)
    for what, bounds in _HELD_AGAINST_MODEL.items():
        if is_cancelled():
            break
        tell(Progress(f"the machine and the model: {what}"))
        explored[what] = held_against_model(bounds)
    return ProtocolProof(steps, explored, is_cancelled())


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
