"""Who has made the turns of a run."""

from __future__ import annotations

from msgspec import Struct


class Counts(Struct):
    """How many turns were made by whom; and claims."""

    by_code: int = 0  #: machine code alone: nothing was enabled, or it ran the event
    in_doubt: int = 0  #: by compiled robots, as machine code was in doubt
    by_robots: int = 0  #: by compiled robots, as there is no code of their kind or event
    claims_by_code: int = 0  #: looks at claims of which code was sure, where these are checked
