"""Turns by the rules alone, for runs that are to show the rules at work."""

from __future__ import annotations

from koord.sampling.compiled.turns import Turns


class ByTheRules(Turns):
    """Turns of which code says nothing."""

    def missed(self, *_: object) -> None:
        return None

    def enabled(self, *_: object) -> None:
        return None

    def run_event(self, *_: object) -> None:
        return None

    def evolved(self, *_: object) -> None:
        return None

    def keeps_contracts(self, *_: object) -> bool:
        return False
