"""What each claim cannot depend on, in words."""

from __future__ import annotations

from collections.abc import Iterator

from koord.api.cones import Cones


def cone_lines(cones: Cones) -> Iterator[str]:
    """A line for each claim that cannot depend on all of the program."""
    for claim, parts in cones.left_out.items():
        yield f"{claim} does not depend on {', '.join(parts)}."
    for claim, parts in cones.returned_to.items():
        what = f"a loop that breaks {claim} has to come back to {', '.join(parts)} all the same"
        yield f"{what}: where one of the slice does not, engines are asked about more than that."
