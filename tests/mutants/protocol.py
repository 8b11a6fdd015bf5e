"""Seeded mistakes in the round-commit protocol and in the wire."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

ROUNDS = "tests/runtime/test_rounds.py"
ELECTIONS = "tests/runtime/test_elections.py"
EXPLORATION = "tests/runtime/test_exploration.py"
CHAOS = "tests/runtime/test_chaos.py"
WIRE = "tests/runtime/test_wire.py"
TRANSPORTS = "tests/runtime/test_transports.py"
KEYS = "tests/runtime/test_keys.py"
ENCRYPTION = "tests/runtime/test_encryption.py"
RECOVERY = "tests/runtime/test_recovery.py"
HANDSHAKE = "tests/runtime/test_handshake.py"
ALIKE = "tests/runtime/test_alike.py"
DEPLOY = "tests/runtime/test_deploy.py"
PROOF = "tests/refinement/test_protocol_proof.py"
CORRESPONDENCE = "tests/refinement/test_protocol_correspondence.py"
STRUCTURES = "tests/refinement/test_protocol_structures.py"

#: What keeps robots in agreement, and what keeps them going.
PROTOCOL = (
    Mutant(
        "two robots get one lock class of a round",
        "runtime.proposals.decide",
        "taken.update(attempt.locks)",
        "taken.clear()",
        (ROUNDS, EXPLORATION),
    ),
    Mutant(
        "who loses a lock does not try its other events",
        "runtime.proposals._let_through",
        "proposal.attempts",
        "proposal.attempts[:1]",
        (ROUNDS,),
    ),
    Mutant(
        "the order never rotates",
        "runtime.proposals.rotating",
        "round_ % robots if robots else 0",
        "0 * round_",
        (ROUNDS,),
    ),
    Mutant(
        "one robot is a majority",
        "runtime.protocol.coordinating._count",
        "holders.bit_count() < turn.setup.majority",
        "not holders",
        (ROUNDS, EXPLORATION),
    ),
    Mutant(
        "acknowledgements of another epoch count",
        "runtime.protocol.coordinating.on_acknowledge",
        "message.epoch == state.promised and message.digest == held.digest",
        "message.digest == held.digest",
        (ELECTIONS,),
    ),
    Mutant(
        "acknowledgements of another entry count",
        "runtime.protocol.coordinating.on_acknowledge",
        "message.epoch == state.promised and message.digest == held.digest",
        "message.epoch == state.promised",
        (ROUNDS, ELECTIONS, EXPLORATION, CHAOS),
    ),
    Mutant(
        "what a robot said before it came back counts",
        "runtime.protocol.state.State.counts",
        "self.roster[robot] == incarnation",
        "incarnation >= 0",
        (ELECTIONS,),
    ),
    Mutant(
        "a robot helps to decide on its own return",
        "runtime.protocol.state.State.counts",
        "admission.robot == robot",
        "admission.robot == robot and robot < 0",
        (ELECTIONS,),
    ),
    Mutant(
        "everyone who is back is admitted at once",
        "runtime.protocol.coordinating._admissions",
        "desk.guests[:most]",
        "desk.guests[: most + 9]",
        (ELECTIONS,),
    ),
    Mutant(
        "the deadline is for those who owe a proposal too",
        "runtime.protocol.coordinating.decide_if_ready",
        "owed(turn) & frozenset(missing)",
        "False",
        (ROUNDS, CHAOS),
    ),
    Mutant(
        "nobody is waited for",
        "runtime.protocol.coordinating.decide_if_ready",
        "not desk.overdue and desk.gathered < setup.robots",
        "False",
        (ROUNDS, CHAOS),
    ),
    Mutant(
        "a coordinator waits longer than it is waited for",
        "runtime.protocol.state.StepContext.await_longer",
        "min(timing.resend_s * 2**tries, timing.silence_s / 3)",
        "timing.resend_s * 2**tries",
        (ROUNDS,),
    ),
    Mutant(
        "a robot may propose for another",
        "runtime.protocol.coordinating.on_propose",
        "proposal.robot != sender",
        "proposal.robot < 0",
        (ROUNDS,),
    ),
    Mutant(
        "the last proposal of a robot counts, and not the first",
        "runtime.protocol.coordinating.gather",
        "desk.proposals.of(proposal.robot) is None",
        "proposal.robot >= 0",
        (ROUNDS,),
    ),
    Mutant(
        "a new coordinator forgets what was being decided",
        "runtime.protocol.coordinating.take_office",
        (
            "if state.tentative is not None:\n"
            "    _put_forward(turn, state.tentative.entry)\n"
            "    return"
        ),
        "turn.change(tentative=None)",
        (ELECTIONS, EXPLORATION, CHAOS),
    ),
    Mutant(
        "robots act on the decision, and not on the commit",
        "runtime.protocol.following.on_decide",
        "turn.change(tentative=Held(message.epoch, entry, mark))",
        (
            "turn.change(tentative=Held(message.epoch, entry, mark))\n"
            "commit(turn, Held(message.epoch, entry, mark))"
        ),
        (ROUNDS, EXPLORATION),
    ),
    Mutant(
        "a commit of another entry is acted on",
        "runtime.protocol.following.on_committed",
        "message.round == state.round and held is not None and held.digest == message.digest",
        "message.round == state.round and held is not None",
        (ROUNDS, EXPLORATION, CHAOS),
    ),
    Mutant(
        "any later entry commits the one held",
        "runtime.protocol.following._commit_if_chained",
        "held is not None and held.digest == previous and round_ == held.round + 1",
        "held is not None and round_ == held.round + 1",
        (ELECTIONS, CHAOS),
    ),
    Mutant(
        "decisions of lower epochs are taken",
        "runtime.protocol.following.follow",
        "turn.send(sender, Overruled(state.promised))\nreturn False",
        "turn.send(sender, Overruled(state.promised))",
        (ELECTIONS,),
    ),
    Mutant(
        "who is not admitted acknowledges",
        "runtime.protocol.following.on_decide",
        (
            "if state.is_voter:\n"
            "    turn.send(sender, Acknowledge(message.epoch, entry.round, mark))"
        ),
        "turn.send(sender, Acknowledge(message.epoch, entry.round, mark))",
        (ELECTIONS,),
    ),
    Mutant(
        "history need not fit",
        "runtime.protocol.following.on_history",
        "entry.round != state.round or entry.previous != state.chain",
        "entry.round < state.round",
        (ROUNDS,),
    ),
    Mutant(
        "nobody asks for what it missed a second time",
        "runtime.protocol.following._unanswered",
        "if state.is_behind:\n    return Ask(state.round)",
        "pass",
        (CHAOS, ELECTIONS),
    ),
    Mutant(
        "a lost acknowledgement stays lost",
        "runtime.protocol.following._unanswered",
        "Acknowledge(held.epoch, held.round, held.digest, again=True)",
        "None if held.epoch >= 0 else Ask(0)",
        (ROUNDS,),
    ),
    Mutant(
        "a vote is given to whoever asks",
        "runtime.protocol.electing.on_candidacy",
        (
            "if message.position < state.position:\n"
            "    teach(turn, sender, message.position.open)\n"
            "    return"
        ),
        "pass",
        (ELECTIONS, EXPLORATION),
    ),
    Mutant(
        "a vote promises nothing",
        "runtime.protocol.electing.on_candidacy",
        "turn.promise(epoch)",
        "pass",
        (ELECTIONS, EXPLORATION),
    ),
    Mutant(
        "votes of another epoch count",
        "runtime.protocol.electing.on_vote",
        "not isinstance(state.office, Candidate) or message.epoch != state.promised",
        "not isinstance(state.office, Candidate)",
        (ELECTIONS,),
    ),
    Mutant(
        "votes for another process of the pid count",
        "runtime.protocol.electing.on_vote",
        "message.candidate == state.incarnation",
        "message.candidate >= 0",
        (ELECTIONS, "tests/runtime/test_twins.py"),
    ),
    Mutant(
        "who hears its coordinator supports another",
        "runtime.protocol.electing.on_canvass",
        "leader is None or leader == sender",
        "leader != state.pid",
        (ELECTIONS,),
    ),
    Mutant(
        "one voice elects",
        "runtime.protocol.electing._count",
        "len(voters) >= turn.setup.majority",
        "voters",
        (ELECTIONS, EXPLORATION),
    ),
    Mutant(
        "a coordinator that hears nobody stays",
        "runtime.protocol.coordinating.check_majority",
        "(desk.heard | 1 << state.pid).bit_count() < turn.setup.majority",
        "not desk.heard | 1 << state.pid",
        (ELECTIONS,),
    ),
    Mutant(
        "nobody is told that it has a twin",
        "runtime.protocol.committing.commit",
        "turn.state.roster[state.pid] > state.incarnation",
        "turn.state.roster[state.pid] < 0",
        (ELECTIONS,),
    ),
    Mutant(
        "epochs belong to nobody",
        "runtime.protocol.electing.on_candidacy",
        "setup.coordinator(epoch) != sender or epoch < state.promised",
        "epoch < state.promised",
        (ELECTIONS,),
    ),
    Mutant(
        "a history has no beginning",
        "runtime.protocol.messages.digest",
        "encode(entry)",
        "encode((entry.decision, entry.admitted, entry.late))",
        (ROUNDS,),
    ),
    Mutant(
        "what a robot ran last is forgotten",
        "runtime.protocol.committing._last_ran",
        "entry.round",
        "entry.round - 1",
        (ELECTIONS, CHAOS),
    ),
)

#: What lets a stranger in, or keeps a friend out.
WIRE_MISTAKES = (
    Mutant(
        "nobody looks at the proof",
        "runtime.wire.frames.Proving._opened",
        "not compare_digest(proof.digest(), datagram[end:])",
        "len(proof.digest()) != len(datagram[end:])",
        (WIRE,),
    ),
    Mutant(
        "the header is not covered by the proof",
        "runtime.wire.frames.Proving._opened",
        "datagram[:end]",
        "datagram[HEADER_BYTES:end]",
        (WIRE,),
    ),
    Mutant(
        "the key is the same for every run",
        "runtime.wire.frames.run_key",
        "_derived(shared_key, identity, b'koord run')",
        "_derived(shared_key, b'', b'koord run')",
        (WIRE,),
    ),
    Mutant(
        "a key that the group can read is taken",
        "runtime.configuration.keys._read",
        "status.st_mode & _OTHERS",
        "status.st_mode & _EVERYBODY",
        (KEYS,),
    ),
    Mutant(
        "a weak key is taken from a file",
        "runtime.configuration.keys._read",
        "weakness(key)",
        "None",
        (KEYS,),
    ),
    Mutant(
        "a new key overwrites another",
        "runtime.configuration.keys.write_key",
        "os.O_WRONLY | os.O_CREAT | os.O_EXCL",
        "os.O_WRONLY | os.O_CREAT",
        (KEYS,),
    ),
    Mutant(
        "a new key can be read by others",
        "runtime.configuration.keys.write_key",
        "os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)",
        "os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)",
        (KEYS,),
    ),
    Mutant(
        "another key takes effect in mid-run",
        "runtime.deploy.entering.Entrance._recollected",
        "key != key_here",
        "key < ''",
        (KEYS,),
    ),
    Mutant(
        "a flood over zenoh fills the memory",
        "runtime.transports.routed.Inbox.__init__",
        "Queue(most)",
        "Queue()",
        (TRANSPORTS,),
    ),
    Mutant(
        "robots encrypt with one key at every start",
        "runtime.wire.encryption.Encrypting._draw",
        "secrets.token_bytes(SALT_BYTES)",
        "bytes(SALT_BYTES)",
        (ENCRYPTION,),
    ),
    Mutant(
        "numbers that do not rise are encrypted with one key",
        "runtime.wire.encryption.Encrypting._closed",
        "number <= self._newest",
        "number < 0",
        (ENCRYPTION,),
    ),
    Mutant(
        "one nonce for all datagrams",
        "runtime.wire.encryption._nonce",
        "number.to_bytes(_NONCE_BYTES, 'big')",
        "bytes(_NONCE_BYTES)",
        (ENCRYPTION,),
    ),
    Mutant(
        "whoever knows the salt can encrypt",
        "runtime.wire.encryption._cipher",
        "blake2b(salt, key=key, digest_size=32, person=b'koord encrypted')",
        "blake2b(salt, key=salt, digest_size=32, person=b'koord encrypted')",
        (ENCRYPTION,),
    ),
    Mutant(
        "strangers fill the memory of salts",
        "runtime.wire.encryption.Encrypting._opened",
        "try:\n    body = cipher.decrypt(_nonce(number), datagram[_BODY_AT:], header)\n"
        "except InvalidTag:\n    return None",
        "self._heard[sender] = salt, cipher\n"
        "try:\n    body = cipher.decrypt(_nonce(number), datagram[_BODY_AT:], header)\n"
        "except InvalidTag:\n    return None",
        (ENCRYPTION,),
    ),
    Mutant(
        "robots that encrypt and robots that do not blame the key",
        "runtime.deploy.joining.Joining.doubt",
        "claims_encryption(datagram) is (not self.party.encrypts)",
        "robot < 0",
        (ENCRYPTION,),
    ),
    Mutant(
        "who comes back at once with another program is not told so",
        "runtime.deploy.joining.Joining.answer",
        "is_same and not start.is_let_in and message.run != self._state.run",
        "not start.is_let_in and message.run != self._state.run",
        ("tests/runtime/test_joining.py",),
    ),
    Mutant(
        "replays are let in",
        "runtime.wire.codec.Window.is_new",
        "self.seen & bit",
        "self.seen < bit",
        (WIRE,),
    ),
    Mutant(
        "what is older than the window is let in",
        "runtime.wire.codec.Window.is_new",
        "if ahead <= -WIDTH:\n    return False",
        "if ahead <= -WIDTH:\n    return True",
        (WIRE,),
    ),
    Mutant(
        "a robot is replayed from before its restart",
        "runtime.wire.codec.Window.is_new",
        "number - self.newest",
        "number % START_STEP - self.newest % START_STEP",
        (WIRE,),
    ),
    Mutant(
        "numbers that came in a row are forgotten",
        "runtime.wire.codec.Window.is_new",
        "(1 << row) - 1",
        "0",
        (WIRE,),
    ),
    Mutant(
        "pieces of two messages are mixed",
        "runtime.wire.codec.Assembly.add",
        "frame.number - piece",
        "0",
        (WIRE,),
    ),
    Mutant(
        "unfinished messages pile up",
        "runtime.wire.codec.Assembly.add",
        "self.most_bytes",
        "self.most_bytes * 1_000_000",
        (WIRE,),
    ),
    Mutant(
        "datagrams grow with their message",
        "runtime.wire.codec.cut",
        "len(body) <= ROOM",
        "len(body) >= 0",
        (WIRE,),
    ),
    Mutant(
        "robots that do not exist are believed in",
        "runtime.wire.bodies._fits",
        "0 <= taken.robot < robots",
        "0 <= taken.robot",
        (WIRE,),
    ),
    Mutant(
        "nonsense with the right key raises",
        "runtime.wire.bodies._decoded",
        "(msgspec.MsgspecError, ValueError, RecursionError)",
        "KeyError",
        (WIRE,),
    ),
    Mutant(
        "values of other languages are let in",
        "runtime.encoding.plain",
        'raise NotPlainError(f"a {type(value).__name__}")',
        "return None",
        (WIRE,),
    ),
    Mutant(
        "great numbers lose their sign",
        "runtime.encoding.big_int",
        'int.from_bytes(data, "big", signed=True)',
        'int.from_bytes(data, "big", signed=False)',
        (WIRE,),
    ),
    Mutant(
        "promises are not saved",
        "runtime.protocol.state.must_save",
        "before.promised != after.promised",
        "before.promised > after.promised",
        (RECOVERY,),
    ),
    Mutant(
        "entries are acknowledged before they are saved",
        "runtime.protocol.machine._with_save",
        "effects.insert(at, Save())",
        "effects.append(Save())",
        (RECOVERY,),
    ),
    Mutant(
        "a robot that recovers votes",
        "runtime.protocol.state.State.is_voter",
        "self.is_on_roster and self.recovery is None",
        "self.is_on_roster",
        (RECOVERY,),
    ),
    Mutant(
        "an old promise is believed",
        "runtime.protocol.recovering.on_answer",
        "turn.promise(message.promised)",
        "turn.hear(message.promised)",
        (RECOVERY,),
    ),
    Mutant(
        "an old entry is kept",
        "runtime.protocol.recovering._take_over",
        "mine.epoch >= tentative.epoch",
        "mine.epoch >= 0",
        (RECOVERY,),
    ),
    Mutant(
        "recovery ends before all have answered",
        "runtime.protocol.recovering._end_if_all_answered",
        "state.recovery.answered >= others and not state.is_behind",
        "len(state.recovery.answered) > 0 and not state.is_behind",
        (RECOVERY,),
    ),
    Mutant(
        "a second proposal is made after a crash",
        "runtime.protocol.recovering._end",
        "state.round == INIT_ROUND or state.pid in turn.setup.owing",
        "state.round >= INIT_ROUND",
        (RECOVERY,),
    ),
    Mutant(
        "answers to an earlier start count",
        "runtime.protocol.recovering.on_answer",
        "recovery is None or recovery.start != message.start",
        "recovery is None",
        (RECOVERY,),
    ),
    Mutant(
        "who has lost its disk answers as one who remembers",
        "runtime.protocol.recovering.on_recovery",
        "not state.is_on_roster",
        "state.recovery is state",
        (RECOVERY,),
    ),
    Mutant(
        "old joins are on the roll",
        "runtime.protocol.handshake._on_join",
        "party.is_leader and message.heard == party.nonce",
        "party.is_leader",
        (HANDSHAKE,),
    ),
    Mutant(
        "any roll is entered",
        "runtime.protocol.handshake.receive",
        "nonces[party.pid] == party.nonce",
        "nonces[party.pid] != NO_RUN",
        (HANDSHAKE,),
    ),
    Mutant(
        "the identity is that of the program",
        "runtime.protocol.handshake.Party.identity",
        "(self.fingerprint, nonces)",
        "(self.fingerprint, len(nonces))",
        (HANDSHAKE,),
    ),
    Mutant(
        "one answer is enough to come late",
        "runtime.protocol.handshake._on_running",
        "len(said) < party.enough",
        "len(said) < 1",
        (HANDSHAKE,),
    ),
    Mutant(
        "answers to an earlier nonce count",
        "runtime.protocol.handshake.receive",
        "sender == party.pid or message.nonce != party.nonce",
        "sender == party.pid",
        (HANDSHAKE,),
    ),
    Mutant(
        "another program is let in",
        "runtime.protocol.handshake._on_join",
        "message.fingerprint != party.fingerprint",
        "len(message.fingerprint) != len(party.fingerprint)",
        (HANDSHAKE,),
    ),
    Mutant(
        "a robot that cannot write goes on",
        "runtime.node.Node._carry_out_all",
        "not self._robot.save(self.state)",
        "self._robot.save(self.state) is None",
        (DEPLOY,),
    ),
    Mutant(
        "a timer that is armed is not the next one to be due",
        "runtime.node.Node._carry_out_all",
        "self._is_soonest_known = False",
        "pass",
        (DEPLOY,),
    ),
    Mutant(
        "who joins later is not heard",
        "runtime.wire.codec.is_handshake",
        "datagram[KIND_AT] >= FIRST_HANDSHAKE_KIND",
        "datagram[KIND_AT] > FIRST_HANDSHAKE_KIND",
        (TRANSPORTS,),
    ),
    Mutant(
        "what was worked out of another history is taken",
        "runtime.alike.keeps_last",
        "all(map(is_, known[0], of))",
        "known[0][-1] is of[-1]",
        (ALIKE,),
    ),
    Mutant(
        "the model's actions do nothing",
        "refinement.protocol_proof.proving._After.after",
        "ways.append(self._prover.term(effect.where, terms))",
        "ways.append(before)",
        (PROOF,),
    ),
    Mutant(
        "what Z3 does not know is proved",
        "refinement.protocol_proof.proving.Prover._asked",
        "answer == z3.unsat",
        "answer != z3.unknown",
        (PROOF,),
    ),
    Mutant(
        "steps that no action explains are let pass",
        "refinement.protocol_proof.correspondence.Correspondence.broken",
        "actions is None",
        "actions == ['nothing']",
        (CORRESPONDENCE,),
    ),
    Mutant(
        "actions of the model may be anything",
        "refinement.protocol_proof.correspondence._lookup",
        "Query(action.parameters, given, action.guard)",
        "Query(action.parameters, given, ())",
        (CORRESPONDENCE,),
    ),
    Mutant(
        "promises are not read from what was said",
        "refinement.protocol_proof.abstraction.Abstraction._state",
        "{(one[0], x) for one in (*voted, *acknowledged) for x in epochs if x < one[1]}",
        "{(one[0], x) for one in voted for x in epochs if x < one[1]}",
        (CORRESPONDENCE,),
    ),
    Mutant(
        "a loop of a query forgets what is bound",
        "refinement.protocol_proof.structures._Writer._loop",
        'tests.append(f"if {places[-1]} == {names[one]}")',
        "pass",
        (STRUCTURES,),
    ),
)
