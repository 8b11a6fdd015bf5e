"""Messages as datagrams: round trips, pieces, and everything hostile."""

from __future__ import annotations

import struct
from random import Random

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.encoding import encode
from koord.runtime.proposals import (
    Admitted,
    Attempt,
    Decision,
    EventFault,
    Faulted,
    Plain,
    Proposal,
    StopRequests,
    Write,
)
from koord.runtime.protocol.handshake import (
    NONCE_BYTES,
    RUN_BYTES,
    HandshakeMessage,
    Join,
    RefusalReason,
    Refused,
    Roll,
    Running,
)
from koord.runtime.protocol.messages import (
    Acknowledge,
    Admission,
    Ask,
    Beacon,
    Candidacy,
    Canvass,
    Committed,
    Decide,
    Hello,
    History,
    LastRun,
    LogEntry,
    Open,
    Overruled,
    Position,
    Propose,
    Recovery,
    RecoveryAnswer,
    RunMessage,
    Snapshot,
    Support,
    Tentative,
    Vote,
)
from koord.runtime.wire.bodies import (
    FIRST_HANDSHAKE_KIND,
    AnyMessage,
    MessageKind,
    handshake_of,
    message_of,
    order_of,
)
from koord.runtime.wire.codec import (
    LONG_PAST,
    MOST_PIECES,
    WIDTH,
    Assembly,
    Channel,
    DatagramReader,
    DatagramWriter,
    HandshakeReader,
    Window,
    cut,
    is_handshake,
)
from koord.runtime.wire.frames import (
    HEADER_BYTES,
    LONGEST,
    ROOM,
    START_STEP,
    Drop,
    Frame,
    Proving,
    fleet_key,
    run_key,
)
from koord.syntax.faults import FaultKind
from tests.sampling import examples

ROBOTS = 5
SHARED_KEY = b"a key of enough bytes"
KEY = run_key(SHARED_KEY, b"monday")
ME = Channel(KEY, ROBOTS, 0)

# --- strategies -----------------------------------------------------------------------------------

scalars = (
    st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5) | st.none()
)
values: st.SearchStrategy[Plain] = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3).map(tuple), max_leaves=8
)
robots = st.integers(0, ROBOTS - 1)
rounds = st.integers(-1, 2**31 - 1)
epochs = st.integers(0, 2**62)
digests = st.binary(min_size=16, max_size=16)
events = st.none() | st.integers(0, 20)
writes = st.lists(
    st.builds(Write, st.integers(0, 9), st.lists(values, max_size=3).map(tuple), values), max_size=3
).map(tuple)
faults = st.builds(EventFault, st.sampled_from(FaultKind), st.text(max_size=9), st.text(max_size=9))
attempts = st.builds(
    Attempt,
    events,
    writes,
    st.lists(st.integers(0, 9), max_size=3).map(tuple),
    st.sampled_from(StopRequests),
    st.none() | faults,
)
proposals = st.builds(
    Proposal, robots, rounds, st.lists(attempts, max_size=2).map(tuple), st.booleans()
)
decisions = st.builds(
    Decision,
    rounds,
    st.lists(st.builds(Admitted, robots, events, st.sampled_from(StopRequests)), max_size=3).map(
        tuple
    ),
    st.lists(robots, max_size=3).map(tuple),
    writes,
    st.binary(max_size=16),
    st.none() | st.builds(Faulted, robots, events, faults),
)
entries = st.builds(
    LogEntry,
    decisions,
    digests,
    st.lists(st.builds(Admission, robots, st.integers(0, 2**63)), max_size=2).map(tuple),
    st.lists(robots, max_size=3).map(tuple),
)
positions = st.builds(Position, rounds, epochs)
rans = st.none() | st.builds(LastRun, rounds, events)
points = st.tuples(*(st.floats(allow_nan=False) for _ in range(3)))
messages: st.SearchStrategy[RunMessage] = st.one_of(
    st.builds(Beacon, points, points, st.floats(allow_nan=False)),
    st.builds(Propose, proposals),
    st.builds(Decide, epochs, entries),
    st.builds(Acknowledge, epochs, rounds, digests, st.booleans()),
    st.builds(Committed, epochs, rounds, digests, st.floats(0, 1e5)),
    st.builds(Open, epochs, rounds, digests),
    st.builds(Ask, rounds),
    st.builds(History, epochs, entries, st.booleans()),
    st.builds(
        Snapshot,
        epochs,
        rounds,
        digests,
        st.lists(st.integers(0, 2**63), min_size=ROBOTS, max_size=ROBOTS).map(tuple),
        st.lists(rans, min_size=ROBOTS, max_size=ROBOTS).map(tuple),
        st.binary(max_size=4000),
    ),
    st.builds(Canvass, epochs, positions),
    st.builds(Candidacy, epochs, positions),
    st.builds(Support, epochs),
    st.builds(Vote, epochs, st.integers(0, 2**63)),
    st.builds(Overruled, epochs),
    st.builds(Hello, st.booleans()),
    st.builds(Recovery, st.integers(1, 2**20)),
    st.builds(
        RecoveryAnswer,
        st.integers(1, 2**20),
        epochs,
        rounds,
        st.none() | st.builds(Tentative, epochs, entries),
    ),
)
nonces = st.binary(min_size=NONCE_BYTES, max_size=NONCE_BYTES)
fingerprints = st.lists(st.tuples(st.text(max_size=9), st.text(max_size=9)), max_size=4).map(tuple)
identities = st.just(b"") | st.binary(min_size=RUN_BYTES, max_size=RUN_BYTES)
handshakes: st.SearchStrategy[HandshakeMessage] = st.one_of(
    st.builds(Join, nonces, st.just(b"") | nonces, identities, fingerprints),
    st.builds(Roll, st.lists(nonces, max_size=200).map(tuple)),
    st.builds(Running, nonces, identities, st.integers(0, 2**62), st.integers(0, 2**20)),
    st.builds(Refused, nonces, st.sampled_from(RefusalReason), fingerprints),
)


def sent(message: RunMessage, pid: int = 1, key: bytes = KEY, start: int = 1) -> list[bytes]:
    return DatagramWriter(Channel(key, ROBOTS, pid, start)).datagrams(3, 7, message)


def big(size: int) -> Snapshot:
    store = Random(size).randbytes(size)
    return Snapshot(1, 2, bytes(16), (0,) * ROBOTS, (None,) * ROBOTS, store)


# --- round trips ----------------------------------------------------------------------------------


@given(messages)
@examples(300)
def test_what_is_written_is_read(message: RunMessage) -> None:
    reader = DatagramReader(ME)
    letters = [reader.read(datagram) for datagram in sent(message)]
    assert letters[:-1] == [None] * (len(letters) - 1)
    last = letters[-1]
    assert last is not None
    assert (last.sender, last.incarnation) == (1, 3)
    assert last.message == message
    assert repr(last.message) == repr(message)
    assert not reader.drops


@given(handshakes)
@examples(200)
def test_what_is_said_in_a_handshake_is_read(message: HandshakeMessage) -> None:
    key = fleet_key(SHARED_KEY, "koord")
    datagrams = DatagramWriter(Channel(key, ROBOTS, 3, 77)).datagrams(0, 0, message)
    reader = HandshakeReader(key, ROBOTS)
    assert [reader.read(datagram) for datagram in datagrams][-1] == (3, message)
    assert not reader.drops
    another = HandshakeReader(fleet_key(SHARED_KEY, "another run"), ROBOTS)
    assert all(another.read(datagram) is None for datagram in datagrams)
    assert another.drops[Drop.FORGED] == len(datagrams)


def test_datagrams_of_other_protocols_are_no_handshakes() -> None:
    (join,) = DatagramWriter(ME).datagrams(0, 0, Join(bytes(NONCE_BYTES), b"", b"", ()))
    assert is_handshake(join)
    assert not is_handshake(b"X" + join[1:])
    assert not is_handshake(join[:2])
    assert not is_handshake(sent(Ask(3))[0])


def test_every_kind_of_message_has_a_number() -> None:
    import typing

    assert len(MessageKind) == len(typing.get_args(AnyMessage))


@pytest.mark.parametrize("value", [2**64, -(2**63) - 1, 10**300, -(10**300)])
def test_whole_numbers_of_any_size_survive(value: int) -> None:
    message = Propose(Proposal(1, 0, (Attempt(0, (Write(0, (value,), (value, (value,))),)),)))
    (datagram,) = sent(message)
    letter = DatagramReader(ME).read(datagram)
    assert letter is not None
    assert letter.message == message


def test_floats_survive_to_the_last_bit() -> None:
    for value in (-0.0, 5e-324, float("inf"), 0.1 + 0.2):
        message = Propose(Proposal(1, 0, (Attempt(0, (Write(0, (), value),)),)))
        letter = DatagramReader(ME).read(sent(message)[0])
        assert letter is not None
        assert repr(letter.message) == repr(message)


@pytest.mark.parametrize("size", [0, ROOM - 200, ROOM, 10 * ROOM, 300_000])
def test_long_messages_travel_in_pieces_in_any_order(size: int) -> None:
    message = big(size)
    datagrams = sent(message)
    assert all(len(datagram) <= LONGEST for datagram in datagrams)
    assert len(datagrams) <= size // ROOM + 2
    Random(size).shuffle(datagrams)
    reader = DatagramReader(ME)
    letters = [letter for datagram in datagrams if (letter := reader.read(datagram)) is not None]
    assert [letter.message for letter in letters] == [message]
    assert not reader.drops


def test_a_message_that_is_too_long_is_refused_when_it_is_sent() -> None:
    with pytest.raises(ValueError, match="too long"):
        cut(bytes(ROOM * MOST_PIECES + 1))


# --- hostile datagrams ----------------------------------------------------------------------------


def dropped(reader: DatagramReader, datagram: bytes) -> Drop:
    """Why a datagram was dropped; it must be, and for one reason."""
    before = dict(reader.drops)
    assert reader.read(datagram) is None
    (why,) = [drop for drop, n in reader.drops.items() if n != before.get(drop, 0)]
    return why


def test_each_kind_of_bad_datagram_is_counted_as_what_it_is() -> None:
    (good,) = sent(Ask(3))
    reader = DatagramReader(ME)
    assert dropped(reader, b"") is Drop.SIZE
    assert dropped(reader, good[:20]) is Drop.SIZE
    assert dropped(reader, good + bytes(LONGEST)) is Drop.SIZE
    assert dropped(reader, b"X" + good[1:]) is Drop.NOT_KOORD
    assert dropped(reader, good[:1] + b"\x09" + good[2:]) is Drop.VERSION
    assert dropped(reader, sent(Ask(3), pid=0)[0]) is Drop.STRANGER
    assert dropped(reader, sent(Ask(3), pid=0, start=2)[0]) is Drop.TWIN
    assert dropped(reader, sent(Ask(3), pid=9)[0]) is Drop.STRANGER
    for other in (run_key(b"another key", b"monday"), run_key(SHARED_KEY, b"tuesday")):
        assert dropped(reader, sent(Ask(3), key=other)[0]) is Drop.FORGED
    assert reader.read(good) is not None
    assert dropped(reader, good) is Drop.REPLAYED
    assert reader.drops.total() == 11


@pytest.mark.parametrize("at", range(sent(Ask(3))[0].__len__() * 8))
def test_no_bit_can_be_flipped(at: int) -> None:
    (good,) = sent(Ask(3))
    flipped = bytearray(good)
    flipped[at // 8] ^= 1 << at % 8
    reader = DatagramReader(ME)
    assert dropped(reader, bytes(flipped)) in (
        Drop.FORGED,
        Drop.STRANGER,
        Drop.VERSION,
        Drop.ENCRYPTED,
        Drop.NOT_KOORD,
    )
    assert reader.read(good) is not None, "the true one still counts"


@given(st.binary(max_size=LONGEST + 10))
@examples(300)
def test_random_bytes_are_dropped(datagram: bytes) -> None:
    dropped(DatagramReader(ME), datagram)


@given(st.sampled_from(MessageKind), st.binary(max_size=60))
@examples(500)
def test_authentic_nonsense_does_not_raise(kind: MessageKind, body: bytes) -> None:
    """A robot that has gone mad, with the right key."""
    seal = Proving(KEY)
    reader = DatagramReader(ME)
    letter = reader.read(seal.put_on(Frame(kind, 1, 0, 0, 0, 0, 1, body)))
    assert (letter is None) == (reader.drops[Drop.MALFORMED] == 1)
    if kind >= FIRST_HANDSHAKE_KIND:
        assert letter is None
    else:
        assert handshake_of(kind, body) is None
    if kind < MessageKind.REQUEST:
        assert order_of(kind, body) is None
    else:
        assert handshake_of(kind, body) is None


@pytest.mark.parametrize(
    "body",
    [
        b"\x91" * 50_000 + b"\xc0",  # lists in lists
        encode((1, (10**6, (), (), (), b"", None))),  # not an entry
        encode((0, ((0, ((9, 0, 0),), (), (), b"", None), b"", (), ()))),  # robot 9 of 5
        encode((0, ((0, ((0, 0, 7),), (), (), b"", None), b"", (), ()))),  # asked for what?
        encode((0, ((0, (), (), ((0, (), b"bytes"),), b"", None), b"", (), ()))),
        msgspec.msgpack.encode((0, ((0, (), (), ((0, (), {}),), b"", None), b"", (), ()))),
        encode((0, ((0, (), (), (), b"", (0, 0, (99, "", ""))), b"", (), ()))),
        b"\xdd\xff\xff\xff\xff",  # a list of 4 billion
        b"",
    ],
)
def test_bodies_of_the_wrong_form_are_no_messages(body: bytes) -> None:
    assert message_of(MessageKind.DECIDE, body, ROBOTS) is None


def test_extensions_other_than_whole_numbers_are_no_messages() -> None:
    for ext in (
        msgspec.msgpack.Ext(2, b"x"),
        msgspec.msgpack.Ext(1, b""),
        msgspec.msgpack.Ext(1, bytes(1 << 17)),
    ):
        flat = (0, ((0, (), (), ((0, (), ext),), b"", None), b"", (), ()))
        assert message_of(MessageKind.DECIDE, msgspec.msgpack.encode(flat), ROBOTS) is None


def test_snapshots_of_another_fleet_are_no_messages() -> None:
    datagrams = sent(Snapshot(0, 0, b"", (0,) * 4, (None,) * 4, b""))
    assert dropped(DatagramReader(ME), datagrams[0]) is Drop.MALFORMED


def test_pauses_that_would_stop_the_fleet_are_no_messages() -> None:
    for pause_s in (-1.0, float("nan"), float("inf")):
        assert dropped(DatagramReader(ME), sent(Committed(0, 0, b"", pause_s))[0]) is Drop.MALFORMED


def test_rounds_long_past_are_not_looked_at() -> None:
    reader = DatagramReader(ME)
    reader.round = 7 + LONG_PAST + 1
    assert dropped(reader, sent(Ask(3))[0]) is Drop.OLD
    reader.round -= 1
    assert reader.read(sent(Ask(3), pid=2)[0]) is not None


def test_the_round_is_covered_by_the_proof() -> None:
    (good,) = sent(Ask(3))
    at = HEADER_BYTES - 8
    assert struct.unpack_from("!i", good, at) == (7,)
    later = good[:at] + struct.pack("!i", 8) + good[at + 4 :]
    assert dropped(DatagramReader(ME), later) is Drop.FORGED


# --- replays --------------------------------------------------------------------------------------


@given(st.lists(st.integers(0, 2 * WIDTH), max_size=60))
def test_a_number_counts_once(numbers: list[int]) -> None:
    window = Window()
    seen: set[int] = set()
    for number in numbers:
        new = window.is_new(number)
        newest = max(seen, default=-1)
        assert new == (number not in seen and number > newest - WIDTH)
        if new:
            seen.add(number)


def test_a_number_counts_once_after_a_long_row() -> None:
    window = Window()
    for number in range(3 * WIDTH):
        assert window.is_new(number)
    assert not window.is_new(3 * WIDTH - 1)
    assert not window.is_new(2 * WIDTH)
    assert not window.is_new(5)
    assert window.is_new(3 * WIDTH + 1)
    assert not window.is_new(3 * WIDTH - 1)
    assert window.is_new(3 * WIDTH)
    assert [window.is_new(3 * WIDTH + k) for k in range(4)] == [False, False, True, True]


def test_a_new_start_is_heard_and_the_old_one_is_no_more() -> None:
    """(R-START)"""
    window = Window()
    assert window.is_new(START_STEP + 100)
    assert window.start == 1
    assert window.is_new(5 * START_STEP)
    assert window.start == 5
    assert not window.is_new(START_STEP + 101)
    assert not window.is_new(5 * START_STEP)
    assert window.is_new(5 * START_STEP + 1)


# --- pieces ---------------------------------------------------------------------------------------


def piece(k: int, of: int, number: int = 0, sender: int = 1, size: int = ROOM) -> Frame:
    return Frame(8, sender, 0, number + k, 0, k, of, bytes([k]) * size)


def test_impossible_pieces_are_dropped() -> None:
    assembly = Assembly()
    assert assembly.add(piece(2, 2)) is Drop.FRAGMENT
    assert assembly.add(piece(0, 0)) is Drop.FRAGMENT
    assert assembly.add(piece(0, MOST_PIECES + 1)) is Drop.FRAGMENT
    assert assembly.add(piece(0, 2, size=3)) is Drop.FRAGMENT
    assert assembly.add(Frame(8, 1, 0, 3, 0, 5, 9, bytes(ROOM))) is Drop.FRAGMENT
    assert assembly.size == 0


def test_pieces_of_different_messages_are_not_mixed() -> None:
    assembly = Assembly()
    assert assembly.add(piece(0, 2, number=0)) is None
    assert assembly.add(piece(1, 2, number=10)) is None
    assert assembly.add(piece(1, 2, number=0, sender=2)) is None
    assert assembly.add(piece(1, 2, number=0)) == bytes(ROOM) + b"\x01" * ROOM


def test_a_piece_twice_is_one_piece() -> None:
    assembly = Assembly()
    assert assembly.add(piece(0, 3)) is None
    assert assembly.add(piece(0, 3)) is None
    assert assembly.size == ROOM


def test_memory_for_unfinished_messages_is_bounded() -> None:
    assembly = Assembly(most_bytes=10 * ROOM)
    for number in range(0, 500, 5):
        assert assembly.add(piece(0, 2, number=number)) is None
        assert assembly.size <= 10 * ROOM
    assert assembly.dropped == 90


def test_messages_that_gave_way_are_counted() -> None:
    reader = DatagramReader(ME, Assembly(most_bytes=2 * ROOM))
    writer = DatagramWriter(Channel(KEY, ROBOTS, 1))
    for _ in range(5):
        reader.read(writer.datagrams(0, 0, big(3 * ROOM))[0])
    assert reader.drops[Drop.UNFINISHED] == 3


def test_messages_of_a_handshake_that_gave_way_are_counted() -> None:
    reader, seal = HandshakeReader(KEY, ROBOTS), Proving(KEY)
    for number in range(1_000):
        assert reader.read(seal.put_on(piece(0, 2, number=2 * number))) is None
    assert set(reader.drops) == {Drop.UNFINISHED}
    assert reader.drops[Drop.UNFINISHED] == 1_000 - (1 << 20) // ROOM
