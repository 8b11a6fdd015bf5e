"""What engines run into: it costs their own answers, and nobody else's."""

from __future__ import annotations

import re
import traceback

from koord.verify.verdicts import Failure

#: Who looks for what makes verdicts say less than they seem to.
VACUITY = "the search for what never happens"

#: Who makes the claims about what is between the ends of rounds.
SHADOWS = "what is asked between rounds"

#: The last place in koord that a traceback names, also where it was in another process.
_PLACE = re.compile(r'File "[^"]*?(koord/[^"]+\.py)", line (\d+)')

#: What is said of an error, in characters.
_STORY = 160


def failure_of(who: str, error: Exception) -> Failure:
    """What became of an engine that raised something."""
    trace = "".join(traceback.format_exception(error))
    story = " ".join(str(error).split())[:_STORY]
    if isinstance(error, MemoryError) or "out of memory" in story:
        return Failure(who, "out of memory", trace=trace)
    places = _PLACE.findall(trace)
    what = f"{type(error).__name__}: {story}" if story else type(error).__name__
    return Failure(who, what, ":".join(places[-1]) if places else "koord", trace)
