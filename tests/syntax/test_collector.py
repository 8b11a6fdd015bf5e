"""The collector of garbage waits, and goes on afterwards as before."""

from __future__ import annotations

import gc

import pytest

from koord.syntax.collector import uncollected


def test_it_waits_and_goes_on_whatever_happens() -> None:
    assert gc.isenabled()
    with uncollected():
        assert not gc.isenabled()
        with uncollected():
            assert not gc.isenabled()
        assert not gc.isenabled()
    assert gc.isenabled()
    with pytest.raises(ValueError, match="so"), uncollected():
        raise ValueError("so")
    assert gc.isenabled()


def test_functions_may_have_it_wait_each_time() -> None:
    @uncollected()
    def waits() -> bool:
        return not gc.isenabled()

    assert waits()
    assert waits()
    assert gc.isenabled()
