"""Claims of whole runs that are all violated are told before the graph is whole. [T-FAIR-CYCLE]

What there is of a graph has fewer runs than the whole and none that this has not: a fair cycle in
it is one of the program, whatever is found later. That none is there says nothing. So each time it
has grown threefold it is asked whether every claim is violated; one that is not needs all of the
graph in any event.

All nodes of a lasso are less than so many rounds from a start as it has. Where all these have been
looked at, no shorter lasso than one round more is to be found: then it is told at once. Else the
graph grows as far as a shorter one may need, and to four times what it was at most.
"""

from __future__ import annotations

from collections.abc import Sequence

from koord.syntax import core
from koord.verify.engines.explicit.fair_answers import FairAnswers, FairCycleReport
from koord.verify.engines.explicit.property_checks import OutOfBounds

#: It is asked first where Python has looked at so many nodes, or machine code, for the time of a
#: look to be less than that of the graph.
LOOK_FROM = 1_024
COMPILED_FACTOR = 16

#: It is asked again where it has grown by so much.
_GROWTH = 3

#: For a shorter lasso the graph grows by so much at most.
_MOST_GROWTH = 4


class Lookout:
    """Looks at what there is of a graph; None for ``look_from``: never.

    ``looked_at`` of its nodes have their edges, among them all that are less than ``rounds`` rounds
    from a start.
    """

    def __init__(
        self, answers: FairAnswers, properties: Sequence[core.Property], look_from: int | None
    ) -> None:
        self._answers, self._next = answers, look_from
        self._properties = list(properties)
        self._longest: int | None = None  #: of the lassos that there are already

    def is_due(self, looked_at: int, rounds: int) -> bool:
        """Return whether to look at the graph now."""
        if self._next is None:
            return False
        is_short = self._longest is not None and self._longest <= rounds + 1
        return looked_at >= self._next or is_short

    def look(self, states: int, looked_at: int, rounds: int) -> FairCycleReport | None:
        """The report on a graph in which all is violated; None to go on."""
        if self._next is None:
            return None
        is_last = self._longest is not None
        if not is_last and not self._are_violated():
            self._next = max(self._next, _GROWTH * looked_at)
            return None
        end = OutOfBounds("every claim is violated", states, rounds)
        report = self._answers.of(self._properties, end)
        self._longest = max(len(run.rounds) for run in report.violated.values())
        if is_last or self._longest <= rounds + 1:
            return report
        self._next = _MOST_GROWTH * looked_at
        return None

    def _are_violated(self) -> bool:
        for place, stated in enumerate(self._properties):
            if not self._answers.is_violated(stated):
                # It is the first to be asked about next time.
                self._properties.insert(0, self._properties.pop(place))
                return False
        return bool(self._properties)
