"""Failures: exceptions in an engine, which cost its own answers and no others."""

from __future__ import annotations

import re
import traceback
from typing import ClassVar

from koord.syntax.content import ByContent

#: Who looks for what makes verdicts say less than they seem to.
VACUITY = "the search for what never happens"

#: Who makes the claims about what is between the ends of rounds.
SHADOWS = "what is asked between rounds"

#: The last place in koord that a traceback names, also where it was in another process.
_PLACE = re.compile(r'File "[^"]*?(koord/[^"]+\.py)", line (\d+)')

#: What is said of an error, in characters.
_STORY = 160


class Failure(ByContent, frozen=True):
    """A failure of an engine, or of other work, which gave no answer.

    ``where`` is the place in koord that is to blame; there is none where memory is. ``trace`` is
    how it came there.
    """

    ASIDE: ClassVar[frozenset[str]] = frozenset({"trace"})

    who: str
    what: str
    where: str = ""
    trace: str = ""
    names: tuple[str, ...] = ()  #: of variables whose numbers have grown too long for it

    def __str__(self) -> str:
        place = f" ({self.where})" if self.where else ""
        return f"{self.who} failed: {self.what}{place}"


def failure_of(who: str, error: Exception) -> Failure:
    """Make the failure of an engine from its exception."""
    trace = "".join(traceback.format_exception(error))
    story = " ".join(str(error).split())[:_STORY]
    if isinstance(error, MemoryError) or "out of memory" in story:
        return Failure(who, "out of memory", trace=trace)
    places = _PLACE.findall(trace)
    what = f"{type(error).__name__}: {story}" if story else type(error).__name__
    return Failure(who, what, ":".join(places[-1]) if places else "koord", trace)
