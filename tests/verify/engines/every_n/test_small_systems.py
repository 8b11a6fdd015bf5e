"""Samples of small systems, where assumptions are hard to meet. [T-EVERY-N]"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from koord.sampling import initial_state_search
from koord.sampling import reached as reached_module
from koord.verify.engines.every_n.language import Language
from koord.verify.engines.every_n.small_systems import Sample, sampled
from tests.loading import EXAMPLES
from tests.verify.engines.every_n.asking import system_of

#: It takes some tries to start as is assumed.
ASSUMED = """
allwrite:
    int[3] given
Move:
    pre: true
    eff: given[0] = given[0]
assume: forall k in 0, 3: given[k] == k + 5
"""


def samples_of(text: str) -> Sequence[Sample]:
    system = system_of(text)
    return sampled(system, Language.of_program(system.program), 0)


@pytest.mark.slow
def test_starts_that_are_hard_to_find_are_given_up_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    tries = 0
    vary = initial_state_search._vary

    def counted(*given: Any, **named: Any) -> None:
        nonlocal tries
        tries += 1
        vary(*given, **named)

    monkeypatch.setattr(initial_state_search, "_vary", counted)
    found = samples_of((EXAMPLES / "task.krd").read_text())
    assert {sample.system.robots for sample in found} == {2, 3, 4}
    assert tries < 500, tries


def test_a_start_is_looked_for_long_where_none_is_found_soon(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(reached_module._Hasty, "start_tries", 0)
    assert samples_of(ASSUMED)
