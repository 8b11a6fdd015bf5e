"""What a compiled program did of a recorded run."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from koord.refinement.compiled_replay import Rerun


def rerun_dict(departure: Rerun, first: int) -> dict[str, object]:
    """It as plain data; rounds count from ``first``, and the one before is the start."""
    from koord.refinement.rounding import Unjudged

    departs = unjudged = None
    if isinstance(departure, Unjudged):
        unjudged = departure.reason
    elif departure is not None:
        departs = {
            "round": departure.round + first,
            "reason": departure.reason,
            "differences": [
                {"robot": c.robot, "location": c.name, "recorded": c.old, "compiled": c.new}
                for c in departure.changes
            ],
        }
    return {"agrees": departs is None, "departs": departs, "unjudged": unjudged}
