"""The seeded mistakes, and the tests that have to notice them."""

from __future__ import annotations

from tests.mutants.bridged import BRIDGED
from tests.mutants.cached import CACHED
from tests.mutants.catalogue_bits import BITS
from tests.mutants.catalogue_certified import CERTIFIED
from tests.mutants.catalogue_claims import JUDGING
from tests.mutants.catalogue_columns import COLUMNS
from tests.mutants.catalogue_compiled import COMPILED
from tests.mutants.catalogue_editors import EDITORS
from tests.mutants.catalogue_exported import EXPORTED
from tests.mutants.catalogue_kernels import KERNELS
from tests.mutants.catalogue_lanes import LANES
from tests.mutants.catalogue_liveness import LIVENESS
from tests.mutants.catalogue_old_forms import OLD_FORMS
from tests.mutants.catalogue_progress import PROGRESS
from tests.mutants.catalogue_reloading import RELOADING
from tests.mutants.catalogue_runs import RUNS
from tests.mutants.catalogue_shown import SHOWN
from tests.mutants.catalogue_tools import TOOLS
from tests.mutants.catalogue_wcet import WCET
from tests.mutants.cone import CONE
from tests.mutants.deployed import DEPLOYED
from tests.mutants.driven import DRIVEN
from tests.mutants.every_n import EVERY_N
from tests.mutants.failing import FAILING
from tests.mutants.flown import FLOWN
from tests.mutants.guarded import GUARDED
from tests.mutants.horn import HORN
from tests.mutants.instants import INSTANTS
from tests.mutants.journalled import JOURNALLED
from tests.mutants.judged import JUDGED
from tests.mutants.located import LOCATED
from tests.mutants.mavlinked import MAVLINKED
from tests.mutants.mutant import Mutant
from tests.mutants.ordered import ORDERED
from tests.mutants.plugged import PLUGGED
from tests.mutants.protocol import PROTOCOL, WIRE_MISTAKES
from tests.mutants.remote import REMOTE
from tests.mutants.ros import ROS
from tests.mutants.simulated import SIMULATED

REPLAY = "tests/traces/test_replay.py"
RUN = "tests/semantics/test_run.py"
AGREEMENT = "tests/agreement/test_symbols.py"
ROUNDS = "tests/verify/encoding/test_rounds.py"
BMC = "tests/verify/engines/bmc/test_engine.py"
INDUCTION = "tests/verify/engines/induction/test_engine.py"
PORTFOLIO = "tests/verify/strategy/test_verification.py"
SINGLY = "tests/verify/strategy/test_each_claim_turn.py"
RACES = "tests/verify/strategy/test_race.py"
COURIER = "tests/api/test_courier.py"
CUBES = "tests/verify/strategy/test_rounds_question.py"
ON_CLUSTER = "tests/cli/test_verify_on_cluster.py"
WITNESS = "tests/verify/test_witness.py"
FOOTPRINT = "tests/syntax/test_footprint.py"
ABSTRACTION = "tests/verify/reduction/test_abstraction.py"
OBSERVERS = "tests/verify/reduction/test_observers.py"
SYMBOLS = "tests/verify/encoding/test_symbols.py"
SOLVING = "tests/verify/encoding/test_solver.py"
REPRESENTATIVES = "tests/verify/engines/induction/test_representatives.py"
TERMS = "tests/verify/encoding/test_terms.py"
CLAIMS = "tests/verify/test_claims.py"
VACUITY = "tests/verify/vacuity/test_vacuity.py"

#: Mistakes in the rules: the program does something else than the text says.
SEMANTICS = (
    Mutant(
        "reads are from the store and not from the snapshot",
        "semantics.rounds.run_event",
        "_to_move(configuration, robot)",
        "replace(_to_move(configuration, robot), copy=configuration.store)",
        (ROUNDS,),
    ),
    Mutant(
        "a lock is never taken",
        "semantics.rounds.run_event",
        "configuration.taken | entered",
        "configuration.taken",
        (ROUNDS,),
    ),
    Mutant(
        "the loser of a lock keeps its local writes",
        "semantics.rounds.run_event",
        'raise IllegalStepError("ATOMIC", f"{name} of robot {robot} enters a taken lock class")',
        "turned = replace(turned, allread={}, allwrite={})",
        (ROUNDS,),
    ),
    Mutant(
        "the order of INIT is ignored",
        "semantics.rounds.initialised",
        "order if order is not None else range(system.robots)",
        "range(system.robots)",
        (ROUNDS,),
    ),
    Mutant(
        "a stopped robot runs events",
        "semantics.rounds.run_event",
        'raise IllegalStepError("STOP", f"robot {robot} has stopped")',
        "pass",
        (RUN,),
    ),
    Mutant(
        "nobody stops because all have asked",
        "semantics.rounds._ended",
        "robots = tuple(replace(state, status=stopped) for state in robots)",
        "del stopped",
        (ROUNDS,),
    ),
    Mutant(
        "an urgent event obliges though its lock is taken",
        "semantics.rounds.may_skip",
        "event.urgent and not event.lock_classes & configuration.taken",
        "event.urgent",
        (ROUNDS,),
    ),
    Mutant(
        "a new round remembers who ran",
        "semantics.rounds._opened",
        "tuple(replace(state, ran=none) for state in configuration.robots)",
        "configuration.robots if none is not None else ()",
        (ROUNDS, BMC),
    ),
    Mutant(
        "copies are not refreshed",
        "semantics.rounds.evolved",
        "replace(state, ports=turned.ports, copy=configuration.store, turn=Turn.PROG)",
        "replace(state, ports=turned.ports, turn=Turn.PROG)",
        (BMC,),
    ),
    Mutant(
        "short circuits evaluate everything",
        "semantics.machine.Machine.within",
        "self.guard = self.both(guard, condition)",
        "pass",
        (AGREEMENT,),
    ),
    Mutant(
        "faults in guards are ignored",
        "semantics.turns.program_turn",
        "broken = m.either(broken, fault)",
        "del fault",
        (BMC,),
    ),
    Mutant(
        "what is unset counts as set",
        "semantics.storage.contents",
        "storage.is_set",
        "d.const(True, BOOL)",
        (BMC,),
    ),
    Mutant(
        "integers are divided toward zero",
        "semantics.domain._quotient",
        "left // right",
        "int(left / right)",
        (TERMS,),
    ),
    Mutant(
        "a break leaves two loops",
        "semantics.statements._loop",
        "m.memory.broke = outer",
        "m.memory.broke = m.either(outer, m.memory.broke)",
        (RUN,),
    ),
    Mutant(
        "a queue gives its last",
        "semantics.statements.pop",
        "zero if isinstance(s.place.type, QueueType) else last",
        "last",
        (RUN,),
    ),
    Mutant(
        "remove takes the last equal element",
        "semantics.statements.remove",
        "range(len(keys) - 1, -1, -1)",
        "range(len(keys))",
        (RUN,),
    ),
    Mutant(
        "a model reads the values after the turn",
        "semantics.places.root",
        "place.primed",
        "place.primed or m.in_environment",
        (BMC,),
    ),
    Mutant(
        "what a contract ensures is not assumed",
        "semantics.environment.environment_turn",
        'm.require("ENV-CONTRACT", kept, f"contract {contract.name}", contract.span)',
        'm.require("ENV-CONTRACT", m.truth(True), f"contract {contract.name}", contract.span)',
        (BMC,),
    ),
    Mutant(
        "a contract is assumed whether or not its requires holds",
        "semantics.environment._kept",
        "m.d.binary(BinaryOp.IMPLIES, required, ensured)",
        "ensured if required is not None else required",
        (BMC,),
    ),
    Mutant(
        "nobody is excused by impossible answers, but by all",
        "semantics.turns.guard_of",
        "m.negated(legal)",
        "m.truth(legal is None)",
        (ROUNDS,),
    ),
    Mutant(
        "who asks to stop has stopped",
        "semantics.turns.turned_by",
        "Status.ASKED",
        "Status.STOPPED",
        (RUN,),
    ),
    Mutant(
        "stop only asks",
        "semantics.turns.turned_by",
        "Status.STOPPED",
        "Status.ASKED",
        (RUN,),
    ),
    Mutant(
        "statements that fault may hold",
        "semantics.expressions.statement",
        "holds = m.both(holds, m.negated(fault))",
        "del fault",
        (BMC,),
    ),
    Mutant(
        "answers need not be within the summary",
        "semantics.expressions.external_call",
        "promises = () if m.oracle.vouches_for(function) else function.ensures",
        "promises: tuple[core.Expr, ...] = ()",
        (BMC,),
    ),
    Mutant(
        "what is chosen may lie outside of its range",
        "semantics.expressions.choose",
        "m.either(empty, between)",
        "m.either(empty, m.truth(between is not None))",
        (BMC,),
    ),
    Mutant(
        "a quantifier over one kind ranges over all",
        "semantics.quantifiers.instances",
        "kind == agent",
        "kind is not None",
        (BMC,),
    ),
    Mutant(
        "negative indices are in range",
        "semantics.values.in_range",
        "d.const(0, INT)",
        "d.const(-9, INT)",
        (RUN,),
    ),
    Mutant(
        "writes of parts do not reach the store",
        "semantics.locations.joined",
        (
            "if mask.parts:\n"
            "    triples = zip(target.parts, source.parts, mask.parts, strict=True)\n"
            "    # Of many elements a robot writes few.\n"
            "    parts = tuple(t if m is None else joined(d, t, s, m) for t, s, m in triples)\n"
            "    patched = Tree(parts)"
        ),
        (
            "if mask.parts and not target.parts:\n"
            "    triples = zip(target.parts, source.parts, mask.parts, strict=True)\n"
            "    # Of many elements a robot writes few.\n"
            "    parts = tuple(t if m is None else joined(d, t, s, m) for t, s, m in triples)\n"
            "    patched = Tree(parts)"
        ),
        (ROUNDS, BMC),
    ),
    Mutant(
        "lost updates ignore the keys of a map",
        "semantics.properties.overlap",
        "[condition, other, equal(d, key, their_key)]",
        "[condition, other]",
        (BMC,),
    ),
    Mutant(
        "lost updates ignore elements and fields",
        "semantics.properties.overlap",
        "[overlap(d, a, b) for a, b in zip(mine.parts, theirs.parts, strict=False)]",
        "[written(d, a) for a in mine.parts]",
        (BMC,),
    ),
)

#: Mistakes in the verifier: it says something else than is so.
VERIFY = (
    Mutant(
        "two robots may enter one lock class",
        "verify.encoding.choices.one_winner_each",
        "constraints += _at_most_one(d, [disjunction(d, x) for x in entering.values()])",
        "del entering",
        (ROUNDS,),
    ),
    Mutant(
        "a robot may run two events",
        "verify.encoding.choices.one_event_each",
        "constraints += _at_most_one(d, mine)",
        "del mine",
        (ROUNDS,),
    ),
    Mutant(
        "stopped robots may run in the formula",
        "verify.encoding.rounds.Encoder._options",
        "[selectable, running, *(x.condition for x in turned.legality)]",
        "[selectable, *(x.condition for x in turned.legality)]",
        (BMC,),
    ),
    Mutant(
        "END-PROG stops nobody in the formula",
        "verify.encoding.rounds.Encoder._end_of_program_turns",
        "d.known(asked) is not False",
        "d.known(asked) is None and d.known(asked) is True",
        (ROUNDS,),
    ),
    Mutant(
        "urgent events oblige nobody",
        "verify.encoding.rounds.Encoder.round",
        (
            "urgency = (\n"
            "    obligations(self.d, self.system, start, options, inputs)\n"
            "    if self._urgent\n"
            "    else []\n"
            ")"
        ),
        "urgency: list[Term] = [] if self._urgent else []",
        (ROUNDS,),
    ),
    Mutant(
        "nobody looks inside a round",
        "verify.encoding.rounds.Encoder.round",
        "not self._urgent and not self._stops_show",
        "self._urgent or True",
        (ROUNDS, BMC),
    ),
    Mutant(
        "nobody sees a round that a skip has begun",
        "verify.encoding.rounds.Encoder.round",
        "[*acting, *free]",
        "acting",
        (ROUNDS,),
    ),
    Mutant(
        "another event undoes what the chosen one wrote to a list",
        "verify.encoding.choices._in_order",
        "joined(d, changed, source, mask)",
        "joined(d, current, source, mask)",
        (ROUNDS,),
    ),
    Mutant(
        "an order need not be transitive",
        "verify.encoding.choices.order_of",
        "places[j]",
        "d.fresh(label, INT)",
        (ROUNDS,),
    ),
    Mutant(
        "there is one order only",
        "verify.encoding.choices.order_of",
        "places[j]",
        "places[i]",
        (ROUNDS,),
    ),
    Mutant(
        "the first writer wins",
        "verify.encoding.choices.winning",
        "precedes(d, robot, other, before)",
        "precedes(d, other, robot, before)",
        (ROUNDS, WITNESS),
    ),
    Mutant(
        "winners are chosen without regard to the order",
        "verify.encoding.choices.winning",
        "precedes(d, robot, other, before)",
        "robot < other",
        (ROUNDS,),
    ),
    Mutant(
        "what is written in loops does not race",
        "verify.encoding.choices.racy_places",
        "statements(event.effect, atomic=False)",
        "event.effect",
        ("tests/verify/encoding/test_races.py",),
    ),
    Mutant(
        "assumptions are dropped",
        "verify.encoding.unrolling.assumed",
        "[holds, *(x.condition for x in legality)]",
        "[holds][:0]",
        (BMC,),
    ),
    Mutant(
        "a faulted configuration has successors",
        "verify.encoding.unrolling.Unrolling._sound",
        "self.solver.add([self.encoder.d.unary(UnaryOp.NOT, moment.findings.fault)])",
        "del moment",
        (BMC,),
    ),
    Mutant(
        "what a faulting step finds counts",
        "verify.encoding.unrolling.violations",
        "claim.kind is not ClaimKind.FAULT",
        "claim.is_state_property",
        (BMC,),
    ),
    Mutant(
        "the replay is not consulted",
        "verify.bounded_check._look",
        "judge(recording, claim, moment.phase)",
        'Counterexample(recording, moment.configuration.round, moment.phase, "")',
        (PORTFOLIO, ABSTRACTION),
    ),
    Mutant(
        "induction assumes what it is to prove",
        "verify.engines.induction.proving._Step.__init__",
        "self._last = taken",
        "self._last = taken\nself._assumed.append(taken.middle)",
        (INDUCTION,),
    ),
    Mutant(
        "induction skips the middle of the round",
        "verify.engines.induction.proving._Step.__init__",
        "taken.moments",
        "taken.moments[-1:]",
        (INDUCTION,),
    ),
    Mutant(
        "induction does not look inside the round",
        "verify.engines.induction.proving._Step.__init__",
        "taken.moments",
        "taken.moments[-2:]",
        (INDUCTION,),
    ),
    Mutant(
        "induction proves what it had no time for",
        "verify.engines.induction.proving._Step._broken_by",
        '{claim: "timeout" if deadline.is_near() else "too much for the solver"}',
        "{}",
        (INDUCTION,),
    ),
    Mutant(
        "induction does not mind what it does not cover",
        "verify.engines.induction.proving.prove",
        "not within_limits",
        "not candidates",
        (INDUCTION,),
    ),
    Mutant(
        "claims that fail stay lemmas",
        "verify.engines.induction.proving.prove",
        "[*given, *candidates]",
        "[*given, *claims]",
        (INDUCTION,),
    ),
    Mutant(
        "induction believes what did not replay",
        "verify.engines.induction.engine.InductionEngine._over",
        "[c for c in ledger.open() if c not in bounded.unreplayed]",
        "ledger.open()",
        (PORTFOLIO,),
    ),
    Mutant(
        "what did not go far enough passes for holds",
        "verify.ledger.Ledger.verdict",
        "not r.reason and _rounds(r) >= self.bounds.rounds",
        "not r.reason",
        (PORTFOLIO,),
    ),
    Mutant(
        "what stopped on the way passes for holds",
        "verify.ledger.Ledger.verdict",
        "not r.reason and _rounds(r) >= self.bounds.rounds",
        "_rounds(r) >= self.bounds.rounds",
        (PORTFOLIO, "tests/verify/test_limits.py"),
    ),
    Mutant(
        "claims that hold through some rounds are lemmas for all",
        "verify.ledger.Ledger.proved",
        "[c for c, v in settled if v.outcome is Outcome.HOLDS and v.rounds is None]",
        "list(self.claims)",
        (PORTFOLIO,),
    ),
    Mutant(
        "rounds that were looked at meanwhile count whatever was proved",
        "verify.strategy.each_claim_turn.EachClaimTurn.work",
        "ledger.open() != open_",
        "not open_",
        (SINGLY,),
    ),
    Mutant(
        "others go on for ever where one is violated",
        "verify.strategy.each_claim_turn.EachClaimTurn.work",
        "ledger.is_violated or not tired",
        "not tired",
        (SINGLY,),
    ),
    Mutant(
        "what takes longer than a slice is given up",
        "verify.strategy.each_claim_turn._slices",
        "[*SLICES, AT_LAST] if wanting > 1 else [AT_LAST]",
        "[SLICES[0]]",
        (SINGLY,),
    ),
    Mutant(
        "who counts first in a race is not waited for",
        "verify.strategy.race.RaceTurn.work",
        "(first, *((each,) for each in beside))",
        "(*((each,) for each in beside), first)",
        (RACES,),
    ),
    Mutant(
        "others know what those who were begun ahead found by chance",
        "verify.strategy.race.RaceTurn._after_head_start",
        "_take_notes(ledger, job, _HEAD_START)",
        "_take_notes(ledger, job)",
        (RACES,),
    ),
    Mutant(
        "who was begun ahead goes on with what is violated",
        "verify.strategy.race.Ahead.violated",
        "verdict.outcome is Outcome.VIOLATED",
        "False",
        (RACES,),
    ),
    Mutant(
        "contexts are made for a search that has its answers",
        "verify.strategy.race.RaceTurn.work",
        "beside[0].has_answers",
        "False",
        (RACES,),
    ),
    Mutant(
        "what takes longer than a glance is done where others wait for it",
        "verify.strategy.race._Glance.is_over",
        "noted.steps > _HEAD_START",
        "False",
        (RACES,),
    ),
    Mutant(
        "what follows a proof that left claims open is done where others wait for it",
        "verify.strategy.race._Glance.is_over",
        "self.turns > 1",
        "False",
        (RACES,),
    ),
    Mutant(
        "some of what is proved at a glance is taken before others are asked",
        "verify.strategy.race.Ahead.settles",
        "wanted(probe)",
        "False",
        (RACES,),
    ),
    Mutant(
        "what a process died of at a glance is begun in the next one like it",
        "verify.strategy.verification._Asking._begun",
        'not is_free or not self.steps.begin(f"glance, {self.stage}", first.number, first.name)',
        "not is_free",
        (RACES,),
    ),
    Mutant(
        "it is looked for contexts that nobody needs before the third",
        "verify.encoding.contexts._made",
        "_made_since >= _FEW <= len(_there)",
        "_made_since >= 2 <= len(_there)",
        ("tests/verify/encoding/test_contexts.py",),
    ),
    Mutant(
        "what was done at a glance is counted",
        "verify.strategy.race._at_a_glance",
        "turns == 2",
        "turns == 3",
        (RACES,),
    ),
    Mutant(
        "what those who were begun ahead found late counts before others are asked",
        "verify.strategy.race.RaceTurn._after_head_start",
        "job.found if _worked(job) <= _HEAD_START else None",
        "job.found",
        (RACES,),
    ),
    Mutant(
        "Ctrl-C is forgotten while those who were begun ahead are heard",
        "verify.strategy.race.RaceTurn._after_head_start",
        "self.pool.is_stopped",
        "False",
        (RACES,),
    ),
    Mutant(
        "who says more is waited for to the end",
        "verify.strategy.race.RaceTurn.work",
        "first and patience is not None and can_fork()",
        "False",
        (RACES,),
    ),
    Mutant(
        "who says more is waited for with no more work than others did",
        "verify.strategy.table.Patience.of",
        "max(others, int(self.times * last) + self.steps)",
        "others",
        (RACES,),
    ),
    Mutant(
        "who has not seen all configurations is asked first",
        "verify.strategy.verification._Asking._is_wanted",
        "has_ended or not row.ended",
        "True",
        (RACES,),
    ),
    Mutant(
        "proofs of what is violated are waited for",
        "verify.strategy.race.RaceTurn._is_hopeless",
        "self.wanted(probe)",
        "False",
        (RACES,),
    ),
    Mutant(
        "what is said too late counts",
        "verify.strategy.race._take_notes",
        "most is not None and steps > most",
        "False",
        (RACES,),
    ),
    Mutant(
        "what holds as far as was asked is settled where it is told",
        "verify.strategy.race._take_notes",
        "outcome is Outcome.UNKNOWN or noted.rounds is not None",
        "outcome is Outcome.UNKNOWN",
        (RACES,),
    ),
    Mutant(
        "behind all answers of a race somebody is begun",
        "verify.strategy.race._Beside.look",
        "self._end_behind(place + 1)",
        "pass",
        (RACES,),
    ),
    Mutant(
        "writers of different things count as writers of the same",
        "verify.engines.explicit.commits.Commits._orders",
        "first.setdefault(writes[position], position)",
        "first.setdefault(writes[position] % 2, position)",
        ("tests/verify/engines/explicit/test_commits.py",),
    ),
    Mutant(
        "what is missing in other samples is missing in these",
        "verify.engines.every_n.disjunctions.Samples._smallest",
        "(without, most, tuple(open_))",
        "(most, tuple(open_))",
        ("tests/verify/engines/every_n/test_disjunctions.py",),
    ),
    Mutant(
        "disjunctions that hold with one literal less are among the smallest",
        "verify.engines.every_n.disjunctions.Samples._looked_for",
        "_is_smallest(x, one, lacks)",
        "True",
        ("tests/verify/engines/every_n/test_disjunctions.py",),
    ),
    Mutant(
        "disjunctions of two literals are the smallest ones of three",
        "verify.engines.every_n.disjunctions._is_smallest",
        "range(len(others))",
        "range(1)",
        ("tests/verify/engines/every_n/test_disjunctions.py",),
    ),
    Mutant(
        "work that goes on in another process is told of at its end",
        "verify.strategy.race._Meter.note",
        "self.process = os.getpid()",
        "pass",
        (RACES,),
    ),
    Mutant(
        "with many robots what is not inductive is asked again",
        "verify.strategy.table",
        "Task(seconds=SPARING_S, evaluations=200_000)",
        "Task(seconds=SPARING_S)",
        ("tests/verify/strategy/test_many_robots.py",),
    ),
    Mutant(
        "what never happens is looked for behind what may be in vain",
        "verify.strategy.verification._ReachabilitySearch.begin",
        "self.pool.submit('', looked, first=True)",
        "self.pool.submit('', looked)",
        ("tests/verify/strategy/test_reachability_search.py",),
    ),
    Mutant(
        "what many robots do counts where few are enough, if it is known by then",
        "verify.strategy.verification._ReachabilitySearch._looked",
        "self.every_n < of_many",
        "False",
        ("tests/verify/strategy/test_reachability_search.py",),
    ),
    Mutant(
        "whoever works beside walks makes them shorter",
        "verify.vacuity.reachability.unbroken",
        "soon = deadline.of_work(_AT_FIRST_S)",
        "soon = deadline.sooner(_AT_FIRST_S)",
        ("tests/verify/vacuity/test_long_walks.py",),
    ),
    Mutant(
        "two of three robots are asked about before all three",
        "verify.vacuity.reachability._of_few",
        "system.robots < _FEWER * len(movers)",
        "len(movers) == system.robots",
        ("tests/verify/vacuity/test_few_robots.py",),
    ),
    Mutant(
        "what is false at one index is false at all",
        "verify.engines.every_n.disjunctions.Samples._false",
        "(of, row[-1], *(row[place] for bit, place in PLACES.items() if of & bit))",
        "(of, *(row[place] for bit, place in PLACES.items() if of & bit))",
        ("tests/verify/engines/every_n/test_lemma_search.py",),
    ),
    Mutant(
        "what happens late is looked for when a solver was asked",
        "verify.vacuity.reachability.unbroken",
        "ever and runs > 0 and pending",
        "False",
        ("tests/verify/vacuity/test_few_robots.py",),
    ),
    Mutant(
        "processes that have answered are left behind",
        "verify.processes.Pool.__exit__",
        "self.reap()",
        "pass",
        ("tests/verify/test_processes.py",),
    ),
    Mutant(
        "the end of each process that has answered is waited for",
        "verify.processes.Pool._leave",
        "not self._is_entered",
        "True",
        ("tests/verify/test_processes.py",),
    ),
    Mutant(
        "somebody is begun before all that was said is heard",
        "verify.processes.Pool._listen",
        "range(_MOST_AT_ONCE)",
        "range(1)",
        ("tests/verify/strategy/test_race.py",),
    ),
    Mutant(
        "losers of a race go on",
        "verify.strategy.race.RaceTurn.work",
        "self.pool.drop(job)",
        "pass",
        (RACES,),
    ),
    Mutant(
        "abc outlives whoever asks",
        "verify.engines.bits.abc._begin",
        "die_with(parent)",
        "pass",
        (RACES,),
    ),
    Mutant(
        "runs in which a robot rests are in no cube",
        "verify.encoding.cubes.cubes",
        "[*range(len(system.agent(robot).events)), NO_EVENT]",
        "[*range(len(system.agent(robot).events))]",
        (CUBES,),
    ),
    Mutant(
        "a claim holds as far as in the best of its cubes",
        "verify.strategy.rounds_question._least",
        "min(found, key=lambda r: (-1 if r.rounds is None else r.rounds, not r.reason))",
        "max(found, key=lambda r: (-1 if r.rounds is None else r.rounds, not r.reason))",
        (CUBES,),
    ),
    Mutant(
        "a cube's shortest run is thought to be the shortest of all",
        "verify.strategy.rounds_question.joined",
        "verdict.fewest and has_fewest(verdict.counterexample, known)",
        "verdict.fewest",
        (CUBES,),
    ),
    Mutant(
        "one round more than is known is not asked about",
        "verify.bounded_check.BoundedCheck.check",
        "len(self._unrolling.rounds) <= self._known",
        "len(self._unrolling.rounds) <= self._known + 1",
        (CUBES,),
    ),
    Mutant(
        "a deadline is sent as a moment of this machine's clock",
        "verify.effort._deadline",
        "Deadline.after(left_s).at",
        "left_s",
        (CUBES,),
    ),
    Mutant(
        "moments of another machine's clock are taken for those of this one",
        "verify.each_claim.Alone.as_of",
        "self.said.moved(began - self.began)",
        "self.said",
        (CUBES,),
    ),
    Mutant(
        "what a worker told of before it died stands twice",
        "verify.processes.Pool._hear",
        "job.noted.clear()",
        "pass",
        (COURIER,),
    ),
    Mutant(
        "a worker with other code answers",
        "verify.helpers.Parcel.checked",
        "code != self.code",
        "False",
        (COURIER,),
    ),
    Mutant(
        "a damaged question is opened",
        "verify.helpers.Parcel.checked",
        "_digest(self.content) != self.digest",
        "False",
        (COURIER,),
    ),
    Mutant(
        "a worker without koord is not noticed",
        "api.courier._checked",
        'versions["packages"].get("koord") is None',
        "False",
        (COURIER,),
    ),
    Mutant(
        "a question goes on when nobody waits for it",
        "api.dask_cluster.unwanted",
        'task is None or task.state != "executing"',
        "False",
        (ON_CLUSTER,),
    ),
    Mutant(
        "a run from another machine counts unseen",
        "verify.strategy.confirmation.confirmed",
        "judge(run.recording, verdict.claim, run.phase)",
        "run.recording",
        (CUBES,),
    ),
    Mutant(
        "what processes need is loaded in each of them",
        "verify.processes.Pool._fill",
        "job.load()",
        "None",
        ("tests/verify/test_processes.py",),
    ),
    Mutant(
        "engines that race are loaded in each process",
        "verify.strategy.race._started",
        "runners[0].load",
        "lambda: None",
        (RACES,),
    ),
    Mutant(
        "a process that asks is asked as well",
        "verify.processes.Pool.submit",
        "self.jobs - 1",
        "self.jobs",
        ("tests/verify/test_processes.py",),
    ),
    Mutant(
        "long lists are claimed to be covered",
        "verify.encoding.unknowns.Unknowns._list",
        "self.limits.append(limit)",
        "del limit",
        (SYMBOLS, PORTFOLIO),
    ),
    Mutant(
        "equal questions get different answers",
        "verify.encoding.unknowns.Unknowns.alike",
        "self.constraints.append(self.d.binary(BinaryOp.IMPLIES, same, agree))",
        "del same, agree",
        (SYMBOLS,),
    ),
    Mutant(
        "the axiom of a summary is dropped",
        "verify.encoding.unknowns.Unknowns.function",
        "self.constraints += [self._axiom(external, promise) for promise in external.ensures]",
        "pass",
        (SYMBOLS, ABSTRACTION),
    ),
    Mutant(
        "the axiom of a summary is negated",
        "verify.encoding.unknowns.Unknowns._axiom.kept",
        "self.d.binary(BinaryOp.IMPLIES, met, statement(m, promise))",
        "self.d.unary(core.UnaryOp.NOT, statement(m, promise))",
        (SYMBOLS, ABSTRACTION),
    ),
    Mutant(
        "what is written in atomic blocks is never written",
        "syntax.walk.statements",
        "atomic or not isinstance(s, core.Atomic)",
        "not isinstance(s, core.Atomic)",
        (FOOTPRINT,),
    ),
    Mutant(
        "lists keep their length whatever is written",
        "syntax.analysis.footprint._note",
        "WriteExtent.PARTS if _inside_list(place) else WriteExtent.WHOLE",
        "WriteExtent.PARTS",
        (FOOTPRINT,),
    ),
    Mutant(
        "who does not ask is never stopped",
        "syntax.analysis.footprint.statuses",
        "asking or _has(agent, core.Stop)",
        "_has(agent, core.TryStop) or _has(agent, core.Stop)",
        (FOOTPRINT,),
    ),
    Mutant(
        "all opaque values are of one type",
        "verify.reduction.abstraction._sort_name",
        "show(type_)",
        '"opaque" if show(type_) else ""',
        (ABSTRACTION,),
    ),
    Mutant(
        "a callers duty is looked into by nobody",
        "verify.reduction.abstraction._flowing",
        "_looked_into(e.requires for e in program.externals)",
        "_looked_into(e.requires for e in program.externals[:0])",
        (ABSTRACTION,),
    ),
    Mutant(
        "merged maps have what both have",
        "verify.reduction.abstraction._Rewriter._promising_merged",
        "either(look(Observer.HAS, old), look(Observer.HAS, new))",
        "binary(BinaryOp.AND, look(Observer.HAS, old), look(Observer.HAS, new))",
        (OBSERVERS,),
    ),
    Mutant(
        "opaque lists are looked into beyond their ends",
        "verify.reduction.observers.observing",
        "binary(BinaryOp.LT, parts[1], parts[2])",
        "binary(BinaryOp.LE, parts[1], parts[2])",
        (OBSERVERS,),
    ),
    Mutant(
        "maps that are merged are made of their parts alone",
        "verify.reduction.observers.constructor",
        "replace(_function(name, types, result), by_answer=True)",
        "replace(_function(name, types, result), by_answer=True, constructs=True)",
        (OBSERVERS,),
    ),
    Mutant(
        "loops are done as often as an opaque list is long",
        "verify.reduction.abstraction._opened",
        "_looked_into((low, high))",
        "set[Type]()",
        (OBSERVERS,),
    ),
    Mutant(
        "of two entries with one key the first counts",
        "verify.reduction.problems._map_of",
        "insert(EXACT, found, key, value)",
        "found if any(identical(key, k) for k, _ in found.entries) else "
        "insert(EXACT, found, key, value)",
        (OBSERVERS,),
    ),
    Mutant(
        "answers are made up without regard to the summary",
        "verify.reduction.problems.Concretion._answered",
        "self._meets(original, arguments, candidate)",
        "self._meets(original, arguments, candidate) or True",
        (ABSTRACTION,),
    ),
    Mutant(
        "the witness drops the order",
        "verify.witness.round_of",
        "_order(reader, symbolic.before) or tuple(range(system.robots))",
        "tuple(range(system.robots))",
        (WITNESS,),
    ),
    Mutant(
        "any two writes that meet are a lost update",
        "traces.replay.update_lost",
        "k != other and slot in updates",
        "k != other",
        (REPLAY,),
    ),
    Mutant(
        "writes that do not meet are a lost update",
        "verify.witness._meetings",
        "overlap(EXACT, its_writes.get(slot), other_writes.get(slot)) is not True",
        "overlap(EXACT, its_writes.get(slot), other_writes.get(slot)) is None",
        (WITNESS,),
    ),
    Mutant(
        "robots move behind the turn that breaks a claim in what is kept of it",
        "verify.witness._first_that_breaks",
        "holds is not True",
        "False",
        (WITNESS,),
    ),
    Mutant(
        "what is not broken is shown all the same",
        "verify.witness._broken_by",
        'raise NotReplayedError(f"{claim.name} is not broken where the run ends")',
        "return last",
        (WITNESS,),
    ),
    Mutant(
        "invariants at rounds are asked for everywhere",
        "verify.claims.Claim.looked_at",
        "phase not in (ClaimPhase.INSIDE, ClaimPhase.MIDDLE)",
        "phase is not None",
        (CLAIMS,),
    ),
    Mutant(
        "the environment is not asked about ports",
        "verify.claims.Claim.looked_at",
        "every and phase is ClaimPhase.END and not self.reads_ports",
        "every and phase is ClaimPhase.END",
        (CLAIMS, BMC),
    ),
    Mutant(
        "one robot stands for two",
        "verify.engines.induction.proving._narrowed",
        "named + 1",
        "named",
        (REPRESENTATIVES,),
    ),
    Mutant(
        "robots stand for those of other kinds",
        "verify.engines.induction.proving._narrowed",
        "(None, system.kinds[0])",
        "(None, *range(9))",
        (REPRESENTATIVES,),
    ),
    Mutant(
        "robots stand for others wherever they are told apart",
        "verify.engines.induction.proving.representatives",
        "not isinstance(symmetry, Symmetry) or symmetry.groups != everyone",
        "not everyone",
        (REPRESENTATIVES,),
    ),
    Mutant(
        "a step of three rounds rests on one",
        "verify.engines.induction.engine.InductionEngine._over",
        "not claims or bounded.completed is None or bounded.completed < depth - 1",
        "not claims or bounded.completed is None",
        ("tests/verify/engines/induction/test_engine.py",),
    ),
    Mutant(
        "what holds for some rounds is a lemma",
        "verify.ledger.Ledger.proved",
        "v.outcome is Outcome.HOLDS and v.rounds is None",
        "v.outcome is Outcome.HOLDS",
        (PORTFOLIO,),
    ),
    Mutant(
        "what some robots cannot do nobody can",
        "verify.vacuity.reachability.unbroken",
        "few.known and not few.claims and few.stuck is None",
        "few.known",
        (PORTFOLIO,),
    ),
    Mutant(
        "robots change places whatever is said of them",
        "verify.reachability_goals._with",
        "(*program.properties, *stated)",
        "program.properties",
        (VACUITY,),
    ),
    Mutant(
        "invariants suppose nothing between the ends of rounds",
        "verify.reachability_goals._suppositions",
        "stated.kind is PropertyKind.INVARIANT",
        "False",
        (VACUITY,),
    ),
    Mutant(
        "what contracts promise is known where it is asked what they suppose",
        "verify.vacuity.unreachable._Asking._freed",
        "replace(self.system, program=without(self.system.program, promises))",
        "self.system",
        (VACUITY,),
    ),
    Mutant(
        "what contracts suppose is looked at after the turn",
        "verify.reachability_goals._is_before",
        "node.primed",
        "False",
        (VACUITY,),
    ),
    Mutant(
        "a function lacks answers if another one can see to it",
        "verify.vacuity.contradictions._hangs_on_others",
        "any(isinstance(node, core.ExternalCall | core.AllValues) for node in below)",
        "not below",
        (VACUITY,),
    ),
    Mutant(
        "goals are reached where some start has them",
        "verify.vacuity.vacuous_goals._holds_at_once",
        "answer is SolverAnswer.UNSAT and not unrolling.unknowns.limits",
        "not unrolling.unknowns.limits",
        (VACUITY,),
    ),
    Mutant(
        "a question that was limited may take any time",
        "verify.encoding.solver.Solver.check",
        "deadline.sooner(_longest_s(limit))",
        "deadline",
        ("tests/verify/encoding/test_solver.py",),
    ),
    Mutant(
        "a question that nobody limited may take any time",
        "verify.encoding.solver.Solver.check",
        "deadline.sooner(LONGEST_UNLIMITED_S)",
        "deadline",
        ("tests/verify/encoding/test_solver.py",),
    ),
    Mutant(
        "limits of a question are those of the first one",
        "verify.encoding.solver.Solver._limit",
        "(lasts_ms, units) != self._limits",
        "self._limits is None",
        ("tests/verify/encoding/test_solver.py",),
    ),
    Mutant(
        "a solver does not hear of the deadline",
        "verify.encoding.solver.Solver._checked",
        "_FOR_EVER if lasts_s is None else _milliseconds(lasts_s)",
        "_FOR_EVER",
        ("tests/verify/test_limits_are_given.py",),
    ),
    Mutant(
        "after a crash a claim has all of its time again",
        "verify.strategy.time_limits._Asking.each",
        "left_s[name] - job.lasted_s",
        "left_s[name]",
        ("tests/verify/strategy/test_time_limits.py",),
    ),
    Mutant(
        "where all is answered proofs cost as much as ever",
        "verify.engines.induction.engine.InductionEngine._effort",
        "ledger.wanting",
        "ledger.open",
        ("tests/verify/engines/induction/test_engine.py",),
    ),
    Mutant(
        "what two robots cannot do no number can",
        "verify.strategy.verification._ReachabilitySearch.end",
        "self.of_any_number",
        "False",
        (VACUITY,),
    ),
    Mutant(
        "what is true of a few robots whatever they do is true of all",
        "verify.vacuity.analysis._unbreakable",
        "regardless = unreachable.true_of_anything(ledger, regardless)",
        "pass",
        (VACUITY,),
    ),
    Mutant(
        "where some of many robots cannot start the others can",
        "verify.vacuity.starts.many_never_start",
        "return never_starts(system, seed, deadline, effort)",
        "return None",
        ("tests/verify/vacuity/test_few_robots.py",),
    ),
    Mutant(
        "what no robots could do is true of anything they did in INIT",
        "verify.vacuity.unreachable._of_anything.free",
        "replace(entry, initial=Start.ARBITRARY)",
        "entry",
        (VACUITY,),
    ),
    Mutant(
        "readings that are not found at random are none",
        "verify.vacuity.contradictions.dead_end",
        "_has_readings(system, robot, state, deadline, seed)",
        "state and False",
        (VACUITY,),
    ),
    Mutant(
        "what excludes each other is supposed",
        "syntax.analysis.suppositions._implication",
        "len(negated) != 1",
        "not (negated := negated[:1])",
        (VACUITY,),
    ),
    Mutant(
        "what excludes each other but for something is supposed",
        "syntax.analysis.suppositions._implication",
        "isinstance(supposed, core.Binary) and supposed.op is BinaryOp.AND",
        "False",
        (VACUITY,),
    ),
    Mutant(
        "all that a function supposes is meant wherever it is called",
        "syntax.analysis.suppositions.SuppositionReader.denials",
        "self._calls[e.function] == 1 and admits(e)",
        "admits(e)",
        (VACUITY,),
    ),
    Mutant(
        "cases forget a denial",
        "verify.encoding.solver._split",
        "[(given, z3.Not(each)) for each in reversed(inside.children())]",
        "[(given, each) for each in reversed(inside.children())]",
        (SOLVING,),
    ),
    Mutant(
        "terms divide as the solver does",
        "verify.encoding.terms.Terms._quotient",
        "make.choice(make.less(zero, right), make.quotient(left, right), opposite)",
        "make.quotient(left, right)",
        (TERMS,),
    ),
    Mutant(
        "places in a ring go round twice",
        "verify.encoding.terms.Terms._remainder",
        "make.total(right, right)",
        "make.total(right, make.total(right, right))",
        (TERMS,),
    ),
)

MUTANTS = (
    *SEMANTICS,
    *VERIFY,
    *CACHED,
    *CONE,
    *EVERY_N,
    *FAILING,
    *INSTANTS,
    *HORN,
    *BITS,
    *KERNELS,
    *JUDGING,
    *COLUMNS,
    *LANES,
    *RELOADING,
    *RUNS,
    *CERTIFIED,
    *EXPORTED,
    *LIVENESS,
    *PROGRESS,
    *JOURNALLED,
    *PROTOCOL,
    *WIRE_MISTAKES,
    *DEPLOYED,
    *DRIVEN,
    *ORDERED,
    *REMOTE,
    *BRIDGED,
    *FLOWN,
    *LOCATED,
    *PLUGGED,
    *MAVLINKED,
    *ROS,
    *GUARDED,
    *JUDGED,
    *COMPILED,
    *EDITORS,
    *OLD_FORMS,
    *TOOLS,
    *WCET,
    *SHOWN,
    *SIMULATED,
)
