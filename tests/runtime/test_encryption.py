"""Encrypted datagrams: what is hidden, what is refused, and that no nonce is used twice."""

from __future__ import annotations

import re
import sys
from hashlib import blake2b
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.api.configurations import check_configuration
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.deploy.job import Job
from koord.runtime.deploy.running import Runner
from koord.runtime.protocol.handshake import HandshakeMessage, Join, Roll
from koord.runtime.protocol.messages import Ask, Message, Overruled, Snapshot
from koord.runtime.wire.codec import (
    Channel,
    DatagramReader,
    DatagramWriter,
    HandshakeReader,
    claims_encryption,
    seal_of,
)
from koord.runtime.wire.frames import (
    HEADER_BYTES,
    LONGEST,
    PROOF_BYTES,
    ROOM,
    SALT_BYTES,
    START_STEP,
    Drop,
    Frame,
    fleet_key,
    run_key,
)
from koord.syntax.source import Source
from tests.loading import example_program
from tests.runtime.hub import Hub
from tests.runtime.test_wire import KEY, ROBOTS, SHARED_KEY, big, dropped, handshakes, messages
from tests.sampling import examples

pytest.importorskip("cryptography")

ME = Channel(KEY, ROBOTS, 0, encrypts=True)
FLEET_KEY = fleet_key(SHARED_KEY, "koord")


def sender(pid: int = 1, key: bytes = KEY, start: int = 1) -> DatagramWriter:
    return DatagramWriter(Channel(key, ROBOTS, pid, start, encrypts=True))


# --- round trips ----------------------------------------------------------------------------------


@given(messages)
@examples(100)
def test_what_is_encrypted_is_read(message: Message) -> None:
    reader = DatagramReader(ME)
    letters = [reader.read(one) for one in sender().datagrams(3, 7, message)]
    last = letters[-1]
    assert last is not None
    assert (last.sender, last.incarnation, last.message) == (1, 3, message)
    assert not reader.drops


@given(handshakes)
@examples(50)
def test_handshakes_are_encrypted_as_well(message: HandshakeMessage) -> None:
    datagrams = sender(3, FLEET_KEY, 77).datagrams(0, 0, message)
    reader = HandshakeReader(FLEET_KEY, ROBOTS, encrypts=True)
    assert [reader.read(one) for one in datagrams][-1] == (3, message)
    assert not reader.drops


@pytest.mark.parametrize("size", [0, ROOM - 200, ROOM, 10 * ROOM])
def test_encrypted_datagrams_are_no_longer_than_others_may_be(size: int) -> None:
    message = big(size)
    datagrams = sender().datagrams(0, 0, message)
    assert max(map(len, datagrams)) <= LONGEST
    if size > ROOM:
        assert len(datagrams[0]) == LONGEST, "pieces are as long as they can be"
    reader = DatagramReader(ME)
    letters = [letter for one in datagrams if (letter := reader.read(one)) is not None]
    assert [letter.message for letter in letters] == [message]


def test_what_is_said_cannot_be_seen() -> None:
    told = b"where the robots are going to be"
    snapshot = Snapshot(1, 2, bytes(16), (0,) * ROBOTS, (None,) * ROBOTS, told)
    (datagram,) = sender().datagrams(0, 0, snapshot)
    assert told not in datagram
    (open_,) = DatagramWriter(Channel(KEY, ROBOTS, 1)).datagrams(0, 0, snapshot)
    assert told in open_
    join = Join(bytes(16), b"", b"", (("param speed", "a secret of the program"),))
    (datagram,) = sender(key=FLEET_KEY).datagrams(0, 0, join)
    assert b"secret" not in datagram


def test_equal_messages_look_different_each_time() -> None:
    bodies = {sender().datagrams(0, 0, Ask(3))[0][HEADER_BYTES:] for _ in range(20)}
    assert len(bodies) == 20


# --- what is refused ------------------------------------------------------------------------------

(GOOD,) = sender().datagrams(3, 7, Ask(3))


@pytest.mark.parametrize("at", range(len(GOOD) * 8))
def test_no_bit_can_be_flipped(at: int) -> None:
    flipped = bytearray(GOOD)
    flipped[at // 8] ^= 1 << at % 8
    reader = DatagramReader(ME)
    assert dropped(reader, bytes(flipped)) in (
        Drop.FORGED,
        Drop.STRANGER,
        Drop.VERSION,
        Drop.UNENCRYPTED,
        Drop.NOT_KOORD,
    )
    assert reader.read(GOOD) is not None, "the true one still counts"


@pytest.mark.parametrize("size", range(HEADER_BYTES, len(GOOD)))
def test_what_is_cut_short_is_refused(size: int) -> None:
    assert dropped(DatagramReader(ME), GOOD[:size]) in (Drop.SIZE, Drop.FORGED)


@pytest.mark.parametrize(
    "key",
    [run_key(b"another key", b"monday"), run_key(SHARED_KEY, b"tuesday"), FLEET_KEY],
    ids=["another key", "another run", "before the run"],
)
def test_other_keys_and_other_runs_are_refused(key: bytes) -> None:
    (datagram,) = sender(key=key).datagrams(3, 7, Ask(3))
    assert dropped(DatagramReader(ME), datagram) is Drop.FORGED


def test_one_salt_does_not_speak_for_another_key() -> None:
    """The cipher of a salt is remembered by sender, once that sender has proved it."""
    reader = DatagramReader(ME)
    assert reader.read(GOOD) is not None
    (other,) = sender(key=run_key(b"another key", b"monday")).datagrams(3, 7, Ask(3))
    salted = (
        other[:HEADER_BYTES]
        + GOOD[HEADER_BYTES : HEADER_BYTES + SALT_BYTES]
        + other[HEADER_BYTES + SALT_BYTES :]
    )
    assert dropped(reader, salted) is Drop.FORGED


def test_replays_are_refused() -> None:
    reader = DatagramReader(ME)
    assert reader.read(GOOD) is not None
    assert dropped(reader, GOOD) is Drop.REPLAYED


def test_whoever_encrypts_and_whoever_does_not_tell_each_other_apart() -> None:
    (open_,) = DatagramWriter(Channel(KEY, ROBOTS, 1)).datagrams(3, 7, Ask(3))
    assert dropped(DatagramReader(ME), open_) is Drop.UNENCRYPTED
    assert dropped(DatagramReader(Channel(KEY, ROBOTS, 0)), GOOD) is Drop.ENCRYPTED
    assert claims_encryption(GOOD) is True
    assert claims_encryption(open_) is False
    for other in (b"X" + GOOD[1:], GOOD[:1] + b"\x09" + GOOD[2:], GOOD[:5]):
        assert claims_encryption(other) is None
    relabelled = GOOD[:1] + open_[1:2] + GOOD[2:]
    assert dropped(DatagramReader(Channel(KEY, ROBOTS, 0)), relabelled) is Drop.FORGED


@given(st.binary(max_size=LONGEST + 10))
@examples(200)
def test_random_bytes_are_dropped(noise: bytes) -> None:
    dropped(DatagramReader(ME), GOOD[:HEADER_BYTES] + noise)


def test_strangers_take_up_no_memory() -> None:
    """Neither do they push out what is remembered of robots."""
    from koord.runtime.wire.encryption import Encrypting

    seal = Encrypting(KEY)
    assert not isinstance(seal.take_off(GOOD, ROBOTS, 0, 1), Drop)
    for k in range(1000):
        salt = k.to_bytes(SALT_BYTES, "big")
        forged = GOOD[:HEADER_BYTES] + salt + GOOD[HEADER_BYTES + SALT_BYTES :]
        assert seal.take_off(forged, ROBOTS, 0, 1) is Drop.FORGED
    assert {pid: salt for pid, (salt, _) in seal._heard.items()} == {
        1: GOOD[HEADER_BYTES : HEADER_BYTES + SALT_BYTES]
    }


# --- nonces ---------------------------------------------------------------------------------------


def nonce_of(datagram: bytes, key: bytes) -> tuple[bytes, bytes]:
    """The key and the nonce that a datagram was encrypted with, by the text of the format."""
    salt = datagram[HEADER_BYTES : HEADER_BYTES + SALT_BYTES]
    number = datagram[13:21]
    return blake2b(salt, key=key, digest_size=32, person=b"koord encrypted").digest(), number


processes = st.lists(
    st.tuples(
        st.integers(0, ROBOTS - 1),
        st.integers(1, 3),
        st.sampled_from([KEY, FLEET_KEY]),
        st.lists(st.sampled_from(["Ask", "Overruled", "Roll", "again"]), min_size=1, max_size=8),
    ),
    min_size=2,
    max_size=6,
)


@given(processes)
@examples(200)
def test_no_nonce_is_used_twice(
    started: list[tuple[int, int, bytes, list[str]]],
) -> None:
    """Whoever starts, as which robot, how often with one start number, and says what.

    An old disk that is brought back has a robot use the numbers of an earlier process again.
    """
    used: set[tuple[bytes, bytes]] = set()
    sent = 0
    for pid, start, key, said in started:
        writer = sender(pid, key, start)
        for word in said:
            match word:
                case "Ask":
                    datagrams = writer.datagrams(0, 0, Ask(3))
                case "Overruled":
                    datagrams = writer.datagrams(0, 0, Overruled(9))
                case "Roll":
                    datagrams = writer.datagrams(0, 0, Roll((bytes(16),) * 200))
                case _:
                    writer.start_again(start)
                    datagrams = []
            used |= {nonce_of(one, key) for one in datagrams}
            sent += len(datagrams)
    assert len(used) == sent


def test_numbers_that_do_not_rise_get_another_salt() -> None:
    seal = seal_of(KEY, encrypts=True)
    numbers = [START_STEP, START_STEP + 1, START_STEP + 1, START_STEP, 2 * START_STEP]
    frames = [Frame(6, 1, 0, number, 0, 0, 1, b"body") for number in numbers]
    salts = [seal.put_on(one)[HEADER_BYTES : HEADER_BYTES + SALT_BYTES] for one in frames]
    assert salts[0] == salts[1]
    assert len({salts[1], salts[2], salts[3]}) == 3
    assert salts[4] == salts[3], "and it is kept while they do rise"


def test_a_frame_is_as_the_text_says() -> None:
    """Opened here by the text of the format alone."""
    from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

    own, number = nonce_of(GOOD, KEY)
    body = GOOD[HEADER_BYTES + SALT_BYTES :]
    plain = ChaCha20Poly1305(own).decrypt(bytes(4) + number, body, GOOD[:HEADER_BYTES])
    frame = seal_of(KEY, encrypts=True).take_off(GOOD, ROBOTS, 0, 1)
    assert isinstance(frame, Frame)
    assert frame.body == plain
    assert len(GOOD) == HEADER_BYTES + SALT_BYTES + len(plain) + PROOF_BYTES


# --- whole runs -----------------------------------------------------------------------------------


class Fleet:
    """Two robots in one process, in virtual time, each with or without the option."""

    def __init__(self, *encrypts: bool) -> None:
        self.hub, self.now = Hub(len(encrypts)), 0.0
        self.runners = []
        classes = loaded(compiled(example_program("sum_of_ids")))
        for pid, option in enumerate(encrypts):
            text = f"num_robots: {len(encrypts)}\nnetwork: {{encrypt: {str(option).lower()}}}\n"
            configuration = load_configuration(Source("c.yaml", text))
            kinds = (0,) * len(encrypts)
            job = Job(classes, kinds, configuration, SHARED_KEY, "run", 0.1, 0.0, 5, None)
            self.runners.append(Runner(job, pid, self.hub.transport(pid), lambda: self.now))

    def turn(self) -> set[int]:
        """Let each robot take a step; return the versions of what was sent."""
        seen = set()
        for runner in self.runners:
            runner.step()
            seen |= {datagram[1] for inbox in self.hub.inboxes for datagram in inbox}
        self.now += 0.05
        return seen


@pytest.mark.parametrize("encrypts", [True, False])
def test_all_that_robots_say_is_encrypted_or_nothing(encrypts: bool) -> None:
    fleet, seen = Fleet(encrypts, encrypts, encrypts), set()
    for _ in range(200):
        seen |= fleet.turn()
    assert {runner.status.round for runner in fleet.runners} == {5}
    assert seen == {3 if encrypts else 2}
    assert not any(runner.status.drops for runner in fleet.runners)


@pytest.mark.parametrize("first", [True, False])
def test_robots_of_which_one_encrypts_name_each_other(first: bool) -> None:
    """(R-NAME): in time, and on both sides."""
    fleet = Fleet(first, not first)
    while fleet.now < 2.0:
        fleet.turn()
    for pid, runner in enumerate(fleet.runners):
        here, there = ("on", "off") if (pid == 0) == first else ("off", "on")
        (note,) = runner.status.notes
        story = f"robot {1 - pid} has encryption {there}, and this robot has it {here}; "
        assert note.startswith(story)
        assert runner.run_id == b""


def test_a_configuration_says_that_it_encrypts() -> None:
    text = "num_robots: 2\nnetwork: {transport: unicast, encrypt: true}\n"
    found = check_configuration(Source("c.yaml", text))
    assert ", unicast, encrypted, " in found.summary()


def test_the_option_is_part_of_what_all_have_in_common() -> None:
    prints = [Fleet(option).runners[0].job.fingerprint for option in (True, False)]
    assert set(prints[0]) ^ set(prints[1]) == {("encryption", "on"), ("encryption", "off")}


# --- what is loaded -------------------------------------------------------------------------------


def test_the_library_is_needed_for_encryption_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "koord.runtime.wire.encryption", raising=False)
    monkeypatch.setitem(sys.modules, "cryptography.exceptions", None)
    assert seal_of(KEY, encrypts=False) is not None
    with pytest.raises(ImportError):
        seal_of(KEY, encrypts=True)


def test_an_encrypted_run_of_processes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program = Path(__file__).parents[2] / "specs" / "examples" / "sum_of_ids.krd"
    config = tmp_path / "c.yaml"
    text = "num_robots: 3\ndelta: 0.02\nnetwork: {encrypt: true}\n"
    config.write_text(text, encoding="utf-8")
    code = main(["deploy", str(program), str(config), "--all-local", "--rounds", "6"])
    out, err = capsys.readouterr()
    assert code == Exit.OK, err
    # Who is in the run first may be heard by one that is not yet in it.
    assert re.search(rf"dropped: (nothing|\d+ {Drop.NO_RUN.value})$", out, re.MULTILINE), out
