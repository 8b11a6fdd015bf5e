"""What a compiled program did of a recorded run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from koord.api import forms

if TYPE_CHECKING:
    from koord.refinement.compiled_replay import Rerun


def compiled_form(departure: Rerun, first: int) -> forms.Compiled:
    """It as JSON has it; rounds count from ``first``, and the one before is the start."""
    from koord.refinement.rounding import Unjudged

    if departure is None:
        return forms.Compiled(True, None, None)
    if isinstance(departure, Unjudged):
        return forms.Compiled(True, None, departure.reason)
    differences = [
        forms.CompiledDifference(change.robot, change.name, change.old, change.new)
        for change in departure.changes
    ]
    departs = forms.Departure(departure.round + first, departure.reason, differences)
    return forms.Compiled(False, departs, None)
