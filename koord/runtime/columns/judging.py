"""What machine code says of claims about the state that columns have: of whom it is not sure.

It has the face of :class:`koord.runtime.monitors.Judge`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from msgspec import Struct

from koord.runtime.compile.machine.made import ClaimCode
from koord.runtime.motion.arrays import Ints

#: So many robots, or pairs of them, of which it is not sure are told, and this many for each robot:
#: a claim of which more do not hold is looked at by Python as a whole.
_ROOM, _ROOM_EACH = 64, 2


class _Look(Struct, frozen=True, eq=False):
    """A look at a claim about some kinds of robots: the code, with all that it is given."""

    run: Callable[..., int]
    given: tuple[int, ...]
    robots: tuple[Ints, ...]  #: whose addresses these are


class CodeJudge:
    """A judge of claims by machine code. ``state`` are the columns.

    Robots follow these: where they are to be asked, it has them told (``tell``).
    """

    def __init__(
        self,
        claims: Mapping[str, Sequence[ClaimCode]],
        kinds: Sequence[int],
        state: tuple[int, ...],
        tell: Callable[[], None],
    ) -> None:
        of = np.array(kinds)
        self._tell = tell
        room = _ROOM + _ROOM_EACH * len(kinds)
        self._found: Ints = np.zeros((room, 2), np.int64)
        to = self._found.ctypes.data, room
        self._room = room
        whole: list[Ints] = [np.flatnonzero(of == kind) for kind in range(int(of.max()) + 1)]
        nobody: Ints = np.zeros(1, np.int64)
        self._looks: dict[str, tuple[int, list[_Look]]] = {}
        for method, codes in claims.items():
            looks = []
            for code in codes:
                robots = [whole[kind] for kind in code.kinds if kind < len(whole)]
                if len(robots) < len(code.kinds):
                    continue  # there are no robots of that kind
                lists = [*robots, nobody, nobody][:2]
                given = tuple(part for one in lists for part in (one.ctypes.data, len(one)))
                looks.append(_Look(code.run, (*state, *given, *to), tuple(lists)))
            self._looks[method] = len(codes[0].kinds), looks

    def unsure(self, method: str) -> list[tuple[int, ...]] | None:
        """The robots of which it is not sure that a claim holds; None if it has no code for it.

        Or if it is sure of fewer than it can say.
        """
        found = self._found_by(method)
        if found is None or found:
            self._tell()
        return found

    def knows(self, method: str) -> bool:
        """Return whether there is code for a claim."""
        return method in self._looks

    def calls(self, method: str) -> list[tuple[Callable[..., int], tuple[int, ...]]]:
        """The functions that look at a claim, and all that each is given."""
        return [(look.run, look.given) for look in self._looks[method][1]]

    def is_sure(self, method: str) -> bool:
        """Return whether code is sure that a claim that it knows holds, of all its robots."""
        _, looks = self._looks[method]
        return not any([look.run(*look.given) for look in looks])

    def _found_by(self, method: str) -> list[tuple[int, ...]] | None:
        known = self._looks.get(method)
        if known is None:
            return None
        width, looks = known
        found: list[tuple[int, ...]] = []
        for look in looks:
            count = look.run(*look.given)
            if count > self._room:
                return None
            if count:
                found += map(tuple, self._found[:count, :width].tolist())
        return found
