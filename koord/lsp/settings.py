"""Settings of the server, as editors send them under ``koord``."""

from __future__ import annotations

from typing import Any, Literal

from msgspec import Struct, ValidationError, convert


class VerifySettings(Struct, frozen=True, rename="camel", forbid_unknown_fields=True):
    """When a program is verified, and how: the options of :func:`koord.verify`."""

    on: Literal["change", "save", "never"] = "change"
    robots: int | Literal["any"] | None = None
    rounds: int = 20
    timeout_s: float = 60.0
    jobs: int | None = None
    cache: bool = False  #: keep verdicts in the folder of the user's cache
    delay_s: float = 0.05  #: from the last change of a text


class LspSettings(Struct, frozen=True, rename="camel", forbid_unknown_fields=True):
    """The settings; ``trace_view`` says that the client shows counterexamples itself."""

    verify: VerifySettings = VerifySettings()
    inlay_hints: bool = True
    trace_view: bool = False


def read_settings(given: Any) -> LspSettings:
    """The settings that a client sends. Raises ValueError, with the reason, for others."""
    if isinstance(given, dict) and "koord" in given:
        given = given["koord"]
    if given is None:
        return LspSettings()
    try:
        return convert(given, LspSettings, strict=False)
    except ValidationError as error:
        raise ValueError(f"settings of koord: {error}") from None
