"""Arrays that an event writes to, copied when it reads them again.

Each robot of a fleet writes its own entry of an array over all robots, which it seldom reads again
in the same event: to copy the array for that would take as long as there are robots.
"""

from __future__ import annotations

from typing import Any

from koord.runtime.operations import check

#: Arrays with fewer elements are copied as quickly as it is noted what is to be put into them.
LONG = 24


class Unput:
    """What an event has put into long arrays among the attributes that it runs on.

    An attribute is gone while something is noted for it: whoever reads it has it made.
    """

    __slots__ = ("_noted",)

    def __init__(self) -> None:
        #: By attribute: the array as it was, and its new elements by index.
        self._noted: dict[str, tuple[tuple[Any, ...], dict[int, Any]]] = {}

    def put(
        self,
        state: dict[str, Any],
        name: str,
        new: Any,
        path: tuple[Any, ...],
        places: tuple[str, ...],
    ) -> bool:
        """Note an element of a long array; False if it is none. Raises FaultError as ``put`` does.

        ``places`` are as in :func:`koord.runtime.operations.put`. [LOCATION] [S-ASSIGN]
        """
        if len(path) != 1:
            return False
        if name in state:
            held = state[name]
            if type(held) is not tuple or len(held) <= LONG:
                return False
            check(held, path, places)
            self._noted[name] = held, {path[0]: new}
            del state[name]
        else:
            held, elements = self._noted[name]
            check(held, path, places)
            elements[path[0]] = new
        return True

    def make(self, state: dict[str, Any], name: str) -> Any:
        """Make the value of an attribute that is gone. Raises KeyError if nothing is noted."""
        held, elements = self._noted.pop(name)
        items = list(held)
        for index, new in elements.items():
            items[index] = new
        state[name] = tuple(items)
        return state[name]

    def make_all(self, state: dict[str, Any]) -> None:
        """Make the values of all attributes that are gone."""
        for name in [name for name in self._noted if name not in state]:
            self.make(state, name)
