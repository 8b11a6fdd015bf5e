"""The claims of a program, before anything is verified."""

from __future__ import annotations

from collections.abc import Mapping

from koord.syntax.source import Span
from koord.syntax.system import System
from koord.verify.claims import claims_of, liveness_of


def claim_places(system: System) -> Mapping[str, Span | None]:
    """The names of what is verified of a system, in order, and where each is stated.

    None: nowhere, as it is asked of every program.
    """
    claims = (*claims_of(system), *liveness_of(system))
    return {one.name: None if one.stated is None else one.stated.span for one in claims}
