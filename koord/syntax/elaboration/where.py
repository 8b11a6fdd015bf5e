"""Where a body stands."""

from __future__ import annotations

from enum import Enum


class Where(Enum):
    """The construct that a body belongs to; the value says it in messages."""

    GUARD = "a guard"
    EFFECT = "an effect"
    INIT = "`init:`"
    ENVIRONMENT = "an `environment:` block"
    FUNCTION = "a function"
    REQUIRES = "the `requires:` of a contract"
    ENSURES = "the `ensures:` of a contract"
    SUMMARY_REQUIRES = "the `requires:` of an external function"
    SUMMARY = "the `ensures:` of an external function"
    PROPERTY = "a property"
    ASSUMPTION = "an assumption"
    INITIAL = "an initial value"
    SHARED_INITIAL = "the initial value of an `allwrite` variable"
    CONSTANT = "a constant"
