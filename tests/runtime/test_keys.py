"""Keys of robots: where they come from, which are refused, and when another one takes effect."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from random import Random
from typing import NoReturn

import pytest

from koord.cli.exits import Exit
from koord.cli.main import main
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.configuration.keys import (
    LEAST_BYTES,
    VARIABLE,
    SharedKey,
    new_key,
    shared_key,
    weakness,
    write_key,
)
from koord.runtime.deploy.job import Job, print_of
from koord.runtime.deploy.running import Runner
from koord.runtime.wire.frames import Drop
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source
from tests.loading import example_program
from tests.runtime.hub import Hub

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"
SUM = str(EXAMPLES / "sum_of_ids.krd")

GOOD, OTHER = "a key that nobody guesses", "another one of that kind"

POSIX = pytest.mark.skipif(os.name != "posix", reason="permissions are those of POSIX")


class Place:
    """A folder with a configuration, and what its key is by it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.config = folder, folder / "c.yaml"

    def key_file(self, text: str | bytes, mode: int = 0o600) -> str:
        path = self.folder / "robots.key"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        path.chmod(mode)
        return path.name

    def found(
        self, network: str, environment: Mapping[str, str] | None = None, mode: int = 0o600
    ) -> SharedKey | None:
        text = f"num_robots: 2\nnetwork: {{{network}}}\n"
        self.config.write_text(text, encoding="utf-8")
        self.config.chmod(mode)
        return shared_key(load_configuration(Source(str(self.config), text)), environment or {})

    def refused(self, network: str, environment: Mapping[str, str] | None = None) -> str:
        with pytest.raises(KoordError) as raised:
            self.found(network, environment)
        (one,) = raised.value.diagnostics
        return f"{one.message}; {one.hint}"


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(tmp_path)


# --- where it comes from --------------------------------------------------------------------------


def test_a_key_is_in_the_configuration_or_in_a_file_or_in_the_environment(place: Place) -> None:
    assert place.found("") is None
    literal = place.found(f"key: {GOOD}")
    assert literal == SharedKey(GOOD.encode())
    place.key_file(GOOD + "\n")
    assert place.found("key_file: robots.key") == literal, "the same key, wherever it stands"
    assert place.found("", {VARIABLE: GOOD}) == literal
    for ending in ("", "\n", "\r\n"):
        place.key_file(GOOD + ending)
        assert place.found("key_file: robots.key") == literal


def test_a_key_file_stands_beside_the_configuration(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir("/")
    place.key_file(GOOD)
    assert place.found("key_file: robots.key") == SharedKey(GOOD.encode())
    assert place.found(f"key_file: {place.folder / 'robots.key'}") == SharedKey(GOOD.encode())


def test_the_environment_counts_first_and_says_so_if_it_differs(place: Place) -> None:
    place.key_file(GOOD)
    assert place.found(f"key: {GOOD}", {VARIABLE: GOOD}) == SharedKey(GOOD.encode())
    for network, where in ((f"key: {GOOD}", "key"), ("key_file: nowhere.key", "key_file")):
        found = place.found(network, {VARIABLE: OTHER})
        assert found is not None
        assert found.key == OTHER.encode()
        (warning,) = found.warnings
        assert warning.code == "K945"
        assert f"`network: {{{where}: …}}`" in warning.message
        assert GOOD not in str(warning)
        assert OTHER not in str(warning)


def test_two_keys_in_one_configuration_are_refused(place: Place) -> None:
    place.key_file(GOOD)
    said = place.refused(f"key: {GOOD}, key_file: robots.key")
    assert said == "the key is given twice; leave `key` out, or `key_file`"


# --- which are refused ----------------------------------------------------------------------------

WEAK = {
    "": "has 0",
    "secret": "has 6",
    "fifteen letters": "has 15",
    "x" * 40: "repeats itself",
    "secretsecretsecret": "repeats itself",
    "ababababababababa": "repeats itself",
    "aaaaaaaaaaaaaaab": "2 different characters",
    "secret0000000001": "7 different characters|what everybody would try",
    "Secret-1234567890": "what everybody would try",
    "koord robots key 2026": "what everybody would try",
    "abcdefghijklmnopqrst": "counts up",
}


@pytest.mark.parametrize("key", WEAK)
def test_weak_keys_are_refused_wherever_they_stand(place: Place, key: str) -> None:
    story = weakness(key.encode())
    assert story is not None
    assert any(part in story for part in WEAK[key].split("|"))
    place.key_file(key)
    for said in (
        place.refused("key_file: robots.key"),
        place.refused("", {VARIABLE: key}),
        place.refused(f"key: {GOOD}", {VARIABLE: key}),
    ):
        assert story in said
        assert "koord config key" in said
    if len(key) >= LEAST_BYTES:
        assert story in place.refused(f"key: '{key}'")


def test_keys_that_are_drawn_are_not_weak() -> None:
    random = Random(1)
    for _ in range(2000):
        assert weakness(random.randbytes(16).hex().encode()) is None
    for key in (GOOD, OTHER, new_key(), "correct horse battery staple"):
        assert weakness(key.encode()) is None
    assert len({new_key() for _ in range(100)}) == 100
    assert len(new_key()) == 64


@POSIX
@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o620, 0o660, 0o666, 0o777])
def test_a_key_file_that_others_can_read_or_write_is_refused(place: Place, mode: int) -> None:
    place.key_file(GOOD, mode)
    said = place.refused("key_file: robots.key")
    assert f"mode {mode:03o}" in said
    assert f"chmod 600 {place.folder / 'robots.key'}" in said
    assert GOOD not in said
    place.key_file(GOOD, 0o400)
    assert place.found("key_file: robots.key") is not None


def test_what_is_no_key_file_is_refused(place: Place) -> None:
    assert "No such file" in place.refused("key_file: robots.key")
    (place.folder / "folder").mkdir()
    assert "no file with a key" in place.refused("key_file: folder")
    place.key_file(GOOD + "\n" + GOOD + "\n")
    assert "one line" in place.refused("key_file: robots.key")
    place.key_file(bytes(range(11, 200)) * 40)
    assert "one line" in place.refused("key_file: robots.key")


@POSIX
def test_a_pipe_is_no_key_file_and_is_not_waited_for(place: Place) -> None:
    os.mkfifo(place.folder / "pipe", 0o600)
    assert "no file with a key" in place.refused("key_file: pipe")


@POSIX
def test_a_configuration_with_a_key_that_everybody_can_read_is_warned_of(place: Place) -> None:
    for mode, warned in ((0o644, True), (0o604, True), (0o640, False), (0o600, False)):
        found = place.found(f"key: {GOOD}", mode=mode)
        assert found is not None
        assert [w.code for w in found.warnings] == ["K945"] * warned
        assert GOOD not in str(found.warnings)
    place.key_file(GOOD)
    found = place.found("key_file: robots.key", mode=0o644)
    assert found is not None
    assert not found.warnings, "there is no key in it"


def test_a_text_that_is_no_file_is_not_warned_of() -> None:
    configuration = load_configuration(
        Source("<stdin>", f"num_robots: 1\nnetwork: {{key: {GOOD}}}\n")
    )
    assert shared_key(configuration, {}) == SharedKey(GOOD.encode())


# --- koord config key -----------------------------------------------------------------------------


def test_a_new_key_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "key"]) == Exit.OK
    key = capsys.readouterr().out.strip()
    assert weakness(key.encode()) is None
    assert main(["config", "key", "-"]) == Exit.OK
    assert capsys.readouterr().out.strip() != key


@POSIX
def test_a_new_key_is_written_for_its_owner_alone(
    place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    path = place.folder / "new.key"
    before = os.umask(0)
    try:
        assert main(["config", "key", str(path)]) == Exit.OK
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    key = path.read_text(encoding="ascii").strip()
    said = capsys.readouterr().out
    assert key not in said
    assert "key_file" in said
    assert place.found("key_file: new.key") == SharedKey(key.encode())


def test_a_key_is_never_overwritten(place: Place, capsys: pytest.CaptureFixture[str]) -> None:
    path = place.folder / "robots.key"
    path.write_text("what stands here", encoding="utf-8")
    assert main(["config", "key", str(path)]) == Exit.BAD_INPUT
    said = capsys.readouterr().err
    assert "K903" in said
    assert "never overwritten" in said
    assert path.read_text(encoding="utf-8") == "what stands here"


def test_where_no_key_can_be_written_none_is_left(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(KoordError, match="cannot be written"):
        write_key(str(place.folder / "nowhere" / "robots.key"))

    def full(*_: object, **__: object) -> NoReturn:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fdopen", full)
    with pytest.raises(KoordError, match="No space left"):
        write_key(str(place.folder / "robots.key"))
    assert not list(place.folder.iterdir())


@pytest.mark.parametrize(
    "words",
    [
        ["config", "key", "one", "two"],
        ["config", "key", "--json"],
        ["config", "key", "--program", SUM],
        ["config", "check"],
    ],
)
def test_words_that_do_not_go_together_are_told(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == Exit.BAD_INPUT
    assert not list(tmp_path.iterdir())


# --- koord deploy ---------------------------------------------------------------------------------


def _deployed(place: Place, network: str) -> int:
    text = f"num_robots: 1\ndelta: 0.02\nnetwork: {{transport: unicast, {network}}}\n"
    place.config.write_text(text, encoding="utf-8")
    state = str(place.folder / "state")
    words = [SUM, str(place.config), "--pid", "0", "--rounds", "3", "--state", state]
    return main(["deploy", *words, "--trace", str(place.folder / "part.jsonl")])


def test_a_robot_runs_with_a_key_from_a_file(
    place: Place, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    place.key_file(GOOD, 0o644)
    assert _deployed(place, "key_file: robots.key") == Exit.BAD_INPUT
    assert "chmod 600" in capsys.readouterr().err
    place.key_file(GOOD)
    assert _deployed(place, "key_file: robots.key") == Exit.OK
    assert capsys.readouterr().err == ""


@POSIX
def test_what_is_doubtful_about_a_key_is_said_at_the_start(
    place: Place, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, OTHER)
    place.config.touch(0o644)
    assert _deployed(place, f"key: {GOOD}") == Exit.OK
    err = capsys.readouterr().err
    assert err.count("warning K945") == 2
    assert "everybody" in err
    assert VARIABLE in err
    assert GOOD not in err
    assert OTHER not in err


def test_what_a_robot_keeps_does_not_have_its_key(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert _deployed(place, f"key: {GOOD}") == Exit.OK
    assert (place.folder / "part.jsonl").is_file()
    files = [path for path in place.folder.rglob("*") if path.is_file()]
    assert [path for path in files if GOOD.encode() in path.read_bytes()] == [place.config]


# --- rotation -------------------------------------------------------------------------------------


class Fleet:
    """Robots with journals, in one process and virtual time."""

    def __init__(self, folder: Path, robots: int = 3) -> None:
        self.folder, self.now = folder, 0.0
        self.hub = Hub(robots)
        self.runners: dict[int, Runner] = {}
        self.sent: list[bytes] = []
        self._classes = loaded(compiled(example_program("sum_of_ids")))

    def start(self, pid: int, key: str) -> Runner:
        """Start a robot with a key, as `koord deploy --pid` would."""
        text = f"num_robots: {self.hub.robots}\n"
        configuration = load_configuration(Source("c.yaml", text))
        shared, kinds = key.encode(), (0,) * self.hub.robots
        job = Job(
            self._classes,
            kinds,
            configuration,
            shared,
            "run",
            0.1,
            0.1,
            None,
            self.folder,
            key_print=print_of(shared, "run"),
        )
        self.hub.inboxes[pid].clear()
        made = self.runners[pid] = Runner(job, pid, self.hub.transport(pid), lambda: self.now)
        return made

    def kill(self, pid: int) -> None:
        self.runners.pop(pid).entrance.close()

    def run(self, until_s: float) -> None:
        until_s += self.now
        while self.now < until_s:
            for runner in self.runners.values():
                runner.step()
                self.sent += [datagram for inbox in self.hub.inboxes for datagram in inbox]
            self.now += 0.02


def test_another_key_takes_effect_with_the_next_run(tmp_path: Path) -> None:
    """In mid-run a robot with another key is not heard, and named; its journal is kept."""
    fleet = Fleet(tmp_path)
    for pid in range(3):
        fleet.start(pid, GOOD)
    fleet.run(5.0)
    run = fleet.runners[0].run_id
    assert run
    assert {one.run_id for one in fleet.runners.values()} == {run}

    fleet.kill(2)
    changed = fleet.start(2, OTHER)
    before = fleet.runners[0].status.round
    fleet.run(5.0)
    assert changed.run_id == b""
    assert "its journal is of a run with another key: not used" in changed.status.notes
    assert any("another key" in note for note in fleet.runners[0].status.notes)
    assert fleet.runners[0].entrance.joining.drops[Drop.FORGED] > 0
    assert fleet.runners[0].status.round > before, "the others go on"

    fleet.kill(2)
    back = fleet.start(2, GOOD)
    fleet.run(5.0)
    assert back.run_id == run, "with the old key it is in the run again"
    assert not back.status.is_mute


def test_robots_that_all_have_another_key_begin_another_run(tmp_path: Path) -> None:
    fleet = Fleet(tmp_path)
    for pid in range(3):
        fleet.start(pid, GOOD)
    fleet.run(3.0)
    run = fleet.runners[0].run_id
    for pid in range(3):
        fleet.kill(pid)
    old = fleet.sent[-60:]
    for pid in range(3):
        fleet.start(pid, OTHER)
    fleet.run(3.0)
    (another,) = {one.run_id for one in fleet.runners.values()}
    assert another not in (b"", run)
    forged = Drop.FORGED.value
    before = dict(fleet.runners[0].status.drops).get(forged, 0)
    fleet.hub.inboxes[0].extend(one for one in old if one[4] != 0)  # in the others' names
    fleet.run(0.02)
    assert dict(fleet.runners[0].status.drops)[forged] > before + 10, "the old key counts no more"
    assert not fleet.runners[0].status.fault
