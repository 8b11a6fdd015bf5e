"""Caches and sessions of the public API."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

import koord
from koord.api import cache as caching
from koord.api import session as sessions
from koord.api.cache import usual_folder

TEXT = """
local:
    int steps = 0
Step:
    pre: steps < 3
    eff: steps = steps + 1
invariant Within: forall i: steps@i <= 3
invariant Never: forall i: steps@i < 2
"""


def source(text: str = TEXT) -> koord.Source:
    return koord.Source("steps.krd", text)


def kept(report: koord.VerifyReport) -> set[str]:
    return {verdict.name for verdict in report.verdicts if verdict.kept}


ALL = {"Within", "Never", "no fault"}


def test_a_cache_knows_what_was_verified_before() -> None:
    cache = koord.Cache()
    first = koord.verify(source(), robots=2, rounds=3, cache=cache)
    again = koord.verify(source(), robots=2, rounds=3, cache=cache)
    assert kept(first) == set()
    assert kept(again) == ALL
    assert kept(koord.verify(source(), robots=2, rounds=3)) == set()
    assert [v.outcome for v in again.verdicts] == [v.outcome for v in first.verdicts]
    assert again.vacuities == first.vacuities
    claims = again.form(koord.api.verdicts.Parts()).claims
    assert all(claim.kept is True for claim in claims)
    assert "kept" not in str(first.to_dict())


@pytest.mark.slow
def test_other_questions_have_other_answers() -> None:
    cache = koord.Cache()
    koord.verify(source(), robots=2, rounds=3, cache=cache)
    assert kept(koord.verify(source(), robots=3, rounds=3, cache=cache)) == set()
    assert kept(koord.verify(source(), robots=2, rounds=2, cache=cache)) == set()
    more = koord.verify(source(), robots=2, rounds=3, max_violations=2, cache=cache)
    assert kept(more) == set()


def test_properties_by_name_are_kept_by_themselves() -> None:
    cache = koord.Cache()
    koord.verify(source(), robots=2, rounds=3, properties=["Within"], cache=cache)
    found = koord.verify(source(), robots=2, rounds=3, cache=cache)
    assert kept(found) == {"Within"}


def test_a_folder_keeps_verdicts_for_other_processes(tmp_path: Path) -> None:
    cache = koord.Cache(tmp_path)
    koord.verify(source(), robots=2, rounds=3, cache=cache)
    assert cache.folder == str(tmp_path)
    assert cache.use().entries > 0
    other = koord.Cache(tmp_path)
    assert kept(koord.verify(source(), robots=2, rounds=3, cache=other)) == ALL
    other.clear()
    assert koord.Cache(tmp_path).use().entries == 0
    found = koord.verify(source(), robots=2, rounds=3, cache=koord.Cache(tmp_path))
    assert kept(found) == set()


def test_another_version_answers_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    koord.verify(source(), robots=2, rounds=3, cache=koord.Cache(tmp_path))
    monkeypatch.setattr(caching, "version_in_use", lambda: "another")
    found = koord.verify(source(), robots=2, rounds=3, cache=koord.Cache(tmp_path))
    assert kept(found) == set()


def test_the_usual_folder_is_that_of_the_platform(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("KOORD_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert usual_folder() == str(tmp_path / "koord")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert usual_folder() == str(tmp_path / ".cache" / "koord")
    monkeypatch.setenv("KOORD_CACHE", str(tmp_path / "mine"))
    assert usual_folder() == str(tmp_path / "mine")


# --- sessions -------------------------------------------------------------------------------------


def test_a_session_knows_what_it_has_found() -> None:
    session = koord.Session(robots=2, rounds=3)
    assert kept(session.verify(source())) == set()
    assert kept(session.verify(source("# moved\n" + TEXT))) == ALL
    more = session.verify(source(TEXT + "invariant Low: forall i: steps@i <= 9\n"))
    assert kept(more) >= {"Within", "no fault"}
    assert not more.verdict("Low").kept
    assert more.verdict("Low").holds


def test_a_newer_call_ends_an_older_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever an older call finds is of a text that nobody sees any more."""
    begun = threading.Event()
    ended: list[str] = []

    def endless(text: str, *, cancellation: koord.Cancellation, **_: object) -> None:
        begun.set()
        while text == "older" and not cancellation.requested:
            pass
        ended.append(text)

    monkeypatch.setattr(sessions, "verify", endless)
    session = koord.Session()
    thread = threading.Thread(target=session.verify, args=("older",))
    thread.start()
    assert begun.wait(60)
    session.verify("newer")
    thread.join(60)
    assert sorted(ended) == ["newer", "older"]
    session.cancel()  # there is nothing left to end


def test_errors_of_a_text_are_raised_and_forget_nothing() -> None:
    session = koord.Session(robots=2, rounds=3)
    session.verify(source())
    with pytest.raises(koord.KoordError):
        session.verify(source(TEXT + "invariant Wrong: z\n"))
    assert kept(session.verify(source())) == ALL
