"""Phrases of messages, and suggestions for misspelt names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from itertools import islice

from msgspec import Struct

from koord.syntax.types import Type, show


def a(type_: Type) -> str:
    """The type in backquotes, with its article."""
    shown = show(type_)
    return f"{'an' if shown[0].lower() in 'aeio' else 'a'} `{shown}`"


def choice(what: str, names: Iterable[str]) -> str:
    """List the choices: ``its ports are `x` and `y` ``, or that there are none."""
    shown = listed(names)
    plural, _, _ = what.removeprefix("its ").partition(" ")
    return f"{what} {shown}" if shown else f"it has no {plural}"


def listed(names: Iterable[str]) -> str:
    """The names in backquotes, with commas and a final `and`."""
    shown = [f"`{name}`" for name in names]
    if len(shown) < 2:
        return "".join(shown)
    return f"{', '.join(shown[:-1])} and {shown[-1]}"


#: Words of other languages for what Koord has under another name.
_ELSEWHERE = {
    "double": "float",
    "real": "float",
    "number": "float",
    "str": "string",
    "text": "string",
    "long": "int",
    "vector": "pos",
    "position": "pos",
    "add": "append",
    "push": "append",
    "enqueue": "append",
    "delete": "remove",
    "dequeue": "pop",
    "size": "length",
    "count": "length",
    "self": "pid",
    "id": "pid",
    "uin": "pid",
}

#: What other languages have, and Koord says otherwise.
_OTHERWISE = {
    "print": "write `stdout << …`, with `using Log`",
    "range": "a loop over numbers is written `for i = 0, n:`",
    "endl": 'write `"\\n"`',
    "null": "there is no such value: a variable is unset until it is written",
    "none": "there is no such value: a variable is unset until it is written",
}

#: Functions of other languages that Koord does not have, and of how many numbers.
_OF_ONE = """acos asin atan ceil cosh exp floor ln log log10 log2 round sinh tan tanh"""
_MATHEMATICS = {
    **dict.fromkeys(_OF_ONE.split(), 1),
    **dict.fromkeys(("fmod", "hypot", "pow"), 2),
}

#: With how many names one misspelt name is compared: all, if they are no more; else those that
#: differ in a letter or two, and some others.
MOST_COMPARED = 100
_OTHERS_COMPARED = 20

#: Names are compared up to here.
_LONGEST = 60

#: Names that are alike share so many of their letters: `nrom` and `norm`, but not `sin` and `min`.
_ALIKE = 0.75

#: A name that is cut short has so many letters left.
_SHORTEST_CUT = 3


def closest(name: str, known: Iterable[str]) -> str | None:
    """The known name most like ``name``, or None if none is much like it."""
    from difflib import get_close_matches  # seldom needed

    index = _indexed(tuple(known))
    wanted = name.lower()
    if wanted in index.folded:
        return index.folded[wanted]
    likely = index.likely(wanted)
    found = get_close_matches(wanted[:_LONGEST], likely, n=1, cutoff=_ALIKE)
    found = found or [o for o in likely if _is_cut(wanted, o) or _is_turned(wanted, o)]
    return index.folded[found[0]] if found else None


def _is_turned(one: str, other: str) -> bool:
    """Return whether two names differ in the order of two letters, as `pns` and `psn`."""
    different = [(a, b) for a, b in zip(one, other, strict=False) if a != b]
    return len(one) == len(other) and len(different) == 2 and different[0] == different[1][::-1]


def _is_cut(one: str, other: str) -> bool:
    """Return whether one name is a prefix of the other, as `max` is of `maximum`."""
    short, long = sorted((one, other), key=len)
    return len(short) >= _SHORTEST_CUT and long.startswith(short)


class _Index(Struct, frozen=True):
    """An index of names in lower case, and of those that become equal without one letter.

    Comparing is slow, and a program with thousands of names may misspell thousands.
    """

    folded: Mapping[str, str]
    shortened: Mapping[str, Sequence[str]]

    def likely(self, wanted: str) -> Sequence[str]:
        """The names that are worth comparing."""
        if len(self.folded) <= MOST_COMPARED:
            return list(self.folded)
        near = dict.fromkeys(
            candidate for part in _shortened(wanted) for candidate in self.shortened.get(part, ())
        )
        if near:
            return list(near)[:MOST_COMPARED]
        alike = (other for other in self.folded if abs(len(other) - len(wanted)) <= 1)
        return list(islice(alike, _OTHERS_COMPARED))


@lru_cache(maxsize=8)
def _indexed(known: tuple[str, ...]) -> _Index:
    folded = {candidate.lower(): candidate for candidate in known}
    shortened: dict[str, list[str]] = {}
    if len(folded) > MOST_COMPARED:
        for candidate in folded:
            for part in _shortened(candidate):
                shortened.setdefault(part, []).append(candidate)
    return _Index(folded, shortened)


def _shortened(name: str) -> set[str]:
    """The name, and the name without each one of its letters.

    Names that differ by a letter more, less or another, or by two that changed places, share one.
    """
    name = name[:_LONGEST]
    return {name, *(name[:k] + name[k + 1 :] for k in range(len(name)))}


def did_you_mean(name: str, known: Iterable[str]) -> str | None:
    """A hint that names the closest known name."""
    known = list(known)
    elsewhere = _ELSEWHERE.get(name.lower())
    found = elsewhere if elsewhere in known else closest(name, known) or _misspelt(name, known)
    return f"did you mean `{found}`?" if found else None


def _misspelt(name: str, known: Iterable[str]) -> str | None:
    """The known name for a misspelt one of other languages, as `append` for `psuh`."""
    others = {other: here for other, here in _ELSEWHERE.items() if here in known}
    near = closest(name, others)
    return others[near] if near is not None else None


def otherwise(name: str) -> str | None:
    """A hint for a name of other languages for which Koord has no name, but another way."""
    return _OTHERWISE.get(name.lower())


def mathematics(name: str) -> str | None:
    """A hint for a function on numbers that Koord does not have."""
    count = _MATHEMATICS.get(name.lower())
    if count is None:
        return None
    parameters = ", ".join(f"float {letter}" for letter in "xy"[:count])
    return f"the language has none: declare it, `def fun {name}({parameters}) -> float: extern`"
