"""The check of the guardian itself: a proof of its invariants, and an exploration."""

from __future__ import annotations

from typing import TYPE_CHECKING

from koord.api.progress import Cancellation, Listener, Progress, asker, heard_by
from koord.api.proofs import Proof, proved
from koord.api.results import html_table

if TYPE_CHECKING:
    from koord.runtime.exploration.guardian import GuardianExplored


class GuardianCheck(Proof, frozen=True):
    """The proof that the guardian keeps its invariants, and the explorations by vehicle."""

    @property
    def invariants(self) -> tuple[str, ...]:
        """The ids of the invariants of specs/guardian that were proved."""
        named = dict.fromkeys(step.statement for step in self.steps)
        left_open = {step.statement for step in self.open}
        return () if self.interrupted else tuple(one for one in named if one not in left_open)

    def to_dict(self) -> dict[str, object]:
        """The result as plain data, as ``koord check-refinement --json`` prints it."""
        return {
            "format": "koord-guardian-check",
            "version": 1,
            "proved": self.ok,
            "invariants": list(self.invariants),
            "explored": [
                {
                    "what": what,
                    "states": one.states,
                    "transitions": one.transitions,
                    "complete": one.complete,
                }
                for what, one in self.explored.items()
            ],
            "broken": [f"{one.broken.claim}: {one.broken.story}" for one in self.violations],
            "steps": [
                {
                    "event": step.action,
                    "rule": step.rule,
                    "invariant": step.statement,
                    "answer": step.answer.value,
                    "counterexample": list(step.counterexample),
                }
                for step in self.steps
            ],
        }

    def __repr__(self) -> str:
        said = "; ".join(f"{one.action}: {one.statement}" for one in self.open)
        return f"<GuardianCheck {len(self.steps)} steps: {said or 'all proved'}>"

    def _repr_html_(self) -> str:
        rows = [(one.action, one.statement, one.answer.value) for one in self.steps]
        return html_table(repr(self), ("event", "invariant", "answer"), rows)


def check_guardian(
    *, progress: Listener | None = None, cancellation: Cancellation | None = None
) -> GuardianCheck:
    """Prove that the guardian keeps its invariants, and explore it.

    The guardian's own functions are run on symbols, and Z3 is asked whether any way that they can
    go breaks an invariant of specs/guardian: for all limits, times and facts. Then all orders and
    ticks are tried in steps of time, for each kind of vehicle, until no state is new.

    Raises :class:`koord.KoordError` where the libraries of the simulator are missing.
    """
    from koord.refinement.guardian_proof.proving import steps as steps_of_proof
    from koord.runtime.exploration.guardian import VEHICLES, explore_guardian

    tell, is_cancelled = heard_by(progress), asker(cancellation)
    explored: dict[str, GuardianExplored] = {}
    steps = proved(steps_of_proof(), tell, is_cancelled)
    for what, limits in VEHICLES.items():
        if is_cancelled():
            break
        tell(Progress(what))
        explored[what] = explore_guardian(limits)
    return GuardianCheck(steps, explored, is_cancelled())
