"""The seeded mistakes, and the tests that have to notice them."""

from __future__ import annotations

from tests.mutants.catalogue_bits import BITS
from tests.mutants.catalogue_compiled import COMPILED
from tests.mutants.catalogue_liveness import LIVENESS
from tests.mutants.deployed import DEPLOYED
from tests.mutants.every_n import EVERY_N
from tests.mutants.mutant import Mutant
from tests.mutants.protocol import PROTOCOL, WIRE_MISTAKES

REPLAY = "tests/semantics/test_replay.py"
RUN = "tests/semantics/test_run.py"
AGREEMENT = "tests/agreement/test_symbols.py"
ROUNDS = "tests/verify/test_rounds.py"
BMC = "tests/verify/test_bmc.py"
INDUCTION = "tests/verify/test_induction.py"
PORTFOLIO = "tests/verify/test_portfolio.py"
WITNESS = "tests/verify/test_witness.py"
FOOTPRINT = "tests/verify/test_footprint.py"
ABSTRACTION = "tests/verify/test_abstraction.py"
SYMBOLS = "tests/verify/test_symbols.py"
SOLVING = "tests/verify/test_solving.py"
REPRESENTATIVES = "tests/verify/test_representatives.py"
TERMS = "tests/verify/test_terms.py"
CLAIMS = "tests/verify/test_claims.py"

#: Mistakes in the rules: the program does something else than the text says.
SEMANTICS = (
    Mutant(
        "reads are from the store and not from the snapshot",
        "semantics/rounds.py",
        "state = _to_move(configuration, robot)\n    if d",
        "state = replace(_to_move(configuration, robot), copy=configuration.store)\n    if d",
        (ROUNDS,),
    ),
    Mutant(
        "a lock is never taken",
        "semantics/rounds.py",
        "taken=configuration.taken | entered,",
        "taken=configuration.taken,",
        (ROUNDS,),
    ),
    Mutant(
        "the loser of a lock keeps its local writes",
        "semantics/rounds.py",
        'raise IllegalStepError("ATOMIC", f"{name} of robot {robot} enters a taken lock class")',
        "turned = replace(turned, allread={}, allwrite={})",
        (ROUNDS,),
    ),
    Mutant(
        "the order of INIT is ignored",
        "semantics/rounds.py",
        "for i in order if order is not None else range(system.robots):",
        "for i in range(system.robots):",
        (ROUNDS,),
    ),
    Mutant(
        "a stopped robot runs events",
        "semantics/rounds.py",
        'raise IllegalStepError("STOP", f"robot {robot} has stopped")',
        "pass",
        (RUN,),
    ),
    Mutant(
        "nobody stops because all have asked",
        "semantics/rounds.py",
        "robots = tuple(replace(state, status=stopped) for state in robots)\n    return",
        "del stopped\n    return",
        (ROUNDS,),
    ),
    Mutant(
        "an urgent event obliges though its lock is taken",
        "semantics/rounds.py",
        "if event.urgent and not event.lock_classes & configuration.taken:",
        "if event.urgent:",
        (ROUNDS,),
    ),
    Mutant(
        "a new round remembers who ran",
        "semantics/rounds.py",
        "return tuple(replace(state, ran=none) for state in configuration.robots)",
        "return configuration.robots if none is not None else ()",
        (ROUNDS, BMC),
    ),
    Mutant(
        "copies are not refreshed",
        "semantics/rounds.py",
        "ports=turned.ports, copy=configuration.store, turn=Turn.PROG)",
        "ports=turned.ports, turn=Turn.PROG)",
        (BMC,),
    ),
    Mutant(
        "short circuits evaluate everything",
        "semantics/machine.py",
        "self.guard = self.both(guard, condition)\n        value",
        "value",
        (AGREEMENT,),
    ),
    Mutant(
        "faults in guards are ignored",
        "semantics/turns.py",
        "broken = m.either(broken, fault)",
        "del fault",
        (BMC,),
    ),
    Mutant(
        "what is unset counts as set",
        "semantics/storage.py",
        "return storage.value, storage.is_set",
        "return storage.value, d.const(True, BOOL)",
        (BMC,),
    ),
    Mutant(
        "integers are divided toward zero",
        "semantics/domain.py",
        "return left // right",
        "return int(left / right)",
        (TERMS,),
    ),
    Mutant(
        "a break leaves two loops",
        "semantics/statements.py",
        "    m.memory.broke = outer\n",
        "    m.memory.broke = m.either(outer, m.memory.broke)\n",
        (RUN,),
    ),
    Mutant(
        "a queue gives its last",
        "semantics/statements.py",
        "position = zero if isinstance(s.place.type, QueueType) else last",
        "position = last",
        (RUN,),
    ),
    Mutant(
        "remove takes the last equal element",
        "semantics/statements.py",
        "for k in range(len(keys) - 1, -1, -1):",
        "for k in range(len(keys)):",
        (RUN,),
    ),
    Mutant(
        "a model reads the values after the turn",
        "semantics/places.py",
        "(m.memory.after if place.primed else m.memory.ports)",
        "(m.memory.after if place.primed or m.in_environment else m.memory.ports)",
        (BMC,),
    ),
    Mutant(
        "what a contract ensures is not assumed",
        "semantics/turns.py",
        'm.require("ENV-CONTRACT", kept, ',
        'm.require("ENV-CONTRACT", m.truth(True), ',
        (BMC,),
    ),
    Mutant(
        "a contract is assumed whether or not its requires holds",
        "semantics/turns.py",
        "return m.d.binary(BinaryOp.IMPLIES, required, ensured)",
        "return ensured if required is not None else required",
        (BMC,),
    ),
    Mutant(
        "nobody is excused by impossible answers, but by all",
        "semantics/turns.py",
        "return m.either(m.both(holds, sound), m.negated(legal)), sound",
        "return m.either(m.both(holds, sound), m.truth(legal is None)), sound",
        (ROUNDS,),
    ),
    Mutant(
        "who asks to stop has stopped",
        "semantics/turns.py",
        "asked = d.binary(BinaryOp.MAX, old, d.const(int(Status.ASKED), INT))",
        "asked = d.binary(BinaryOp.MAX, old, d.const(int(Status.STOPPED), INT))",
        (RUN,),
    ),
    Mutant(
        "stop only asks",
        "semantics/turns.py",
        "new = d.ite(memory.stop, d.const(int(Status.STOPPED), INT), new)",
        "new = d.ite(memory.stop, d.const(int(Status.ASKED), INT), new)",
        (RUN,),
    ),
    Mutant(
        "statements that fault may hold",
        "semantics/expressions.py",
        "holds = m.both(holds, m.negated(fault))",
        "del fault",
        (BMC,),
    ),
    Mutant(
        "answers need not be within the summary",
        "semantics/expressions.py",
        "promises = () if m.oracle.vouches_for(function) else function.ensures",
        "promises: tuple[core.Expr, ...] = ()",
        (BMC,),
    ),
    Mutant(
        "what is chosen may lie outside of its range",
        "semantics/expressions.py",
        'm.require("CHOOSE", m.either(empty, between), ',
        'm.require("CHOOSE", m.either(empty, m.truth(between is not None)), ',
        (BMC,),
    ),
    Mutant(
        "a quantifier over one kind ranges over all",
        "semantics/quantifiers.py",
        "if agent is None or kind == agent:",
        "if agent is None or kind is not None:",
        (BMC,),
    ),
    Mutant(
        "negative indices are in range",
        "semantics/values.py",
        "low = d.binary(BinaryOp.LE, d.const(0, INT), index)",
        "low = d.binary(BinaryOp.LE, d.const(-9, INT), index)",
        (RUN,),
    ),
    Mutant(
        "writes of parts do not reach the store",
        "semantics/masks.py",
        "        if mask.parts:\n            triples = zip(target.parts",
        "        if mask.parts and not target.parts:\n            triples = zip(target.parts",
        (ROUNDS, BMC),
    ),
    Mutant(
        "lost updates ignore the keys of a map",
        "semantics/races.py",
        "met.append(conjunction(d, [condition, other, equal(d, key, their_key)]))",
        "met.append(conjunction(d, [condition, other]))",
        (BMC,),
    ),
    Mutant(
        "lost updates ignore elements and fields",
        "semantics/races.py",
        "met += [overlap(d, a, b) for a, b in zip(mine.parts, theirs.parts, strict=False)]",
        "met += [written(d, a) for a in mine.parts]",
        (BMC,),
    ),
)

#: Mistakes in the verifier: it says something else than is so.
VERIFY = (
    Mutant(
        "two robots may enter one lock class",
        "verify/choices.py",
        "constraints += _at_most_one(d, [disjunction(d, x) for x in entering.values()])",
        "del entering",
        (ROUNDS,),
    ),
    Mutant(
        "a robot may run two events",
        "verify/choices.py",
        "constraints += _at_most_one(d, mine)",
        "del mine",
        (ROUNDS,),
    ),
    Mutant(
        "stopped robots may run in the formula",
        "verify/rounds.py",
        "self.d, [selectable, running, *(x.condition for x in turned.legality)]",
        "self.d, [selectable, *(x.condition for x in turned.legality)]",
        (BMC,),
    ),
    Mutant(
        "END-PROG stops nobody in the formula",
        "verify/rounds.py",
        "        if d.known(asked) is not False:\n            stopped",
        "        if d.known(asked) is None and d.known(asked) is True:\n            stopped",
        (ROUNDS,),
    ),
    Mutant(
        "urgent events oblige nobody",
        "verify/rounds.py",
        "urgency = obligations(self.d, self.system, start, options, inputs)",
        "urgency: list[Term] = []",
        (ROUNDS,),
    ),
    Mutant(
        "nobody looks inside a round",
        "verify/rounds.py",
        "if not self._urgent and not self._stops_show:",
        "if self._urgent or True:",
        (ROUNDS, BMC),
    ),
    Mutant(
        "nobody sees a round that a skip has begun",
        "verify/rounds.py",
        "begun = disjunction(self.d, [*acting, *free])",
        "begun = disjunction(self.d, acting)",
        (ROUNDS,),
    ),
    Mutant(
        "another event undoes what the chosen one wrote to a list",
        "verify/commits.py",
        "changed = joined(d, changed, source, mask)",
        "changed = joined(d, current, source, mask)",
        (ROUNDS,),
    ),
    Mutant(
        "an order need not be transitive",
        "verify/choices.py",
        "if not before:\n        return []",
        "if before is not None:\n        return []",
        (ROUNDS,),
    ),
    Mutant(
        "the first writer wins",
        "verify/races.py",
        "precedes(d, robot, other, before)])",
        "precedes(d, other, robot, before)])",
        (ROUNDS, WITNESS),
    ),
    Mutant(
        "winners are chosen without regard to the order",
        "verify/races.py",
        "conjunction(d, [flags[other][location], precedes(d, robot, other, before)])",
        "conjunction(d, [flags[other][location], robot < other])",
        (ROUNDS,),
    ),
    Mutant(
        "what is written in loops does not race",
        "verify/races.py",
        "case core.ForRange(body=body) | core.ForEach(body=body):",
        "case core.ForEach(body=body):",
        ("tests/verify/test_races.py",),
    ),
    Mutant(
        "assumptions are dropped",
        "verify/bmc.py",
        "needed += [holds, *(x.condition for x in legality)]",
        "needed += [holds][:0]",
        (BMC,),
    ),
    Mutant(
        "a faulted configuration has successors",
        "verify/bmc.py",
        "self.solver.add([self.encoder.d.unary(UnaryOp.NOT, moment.findings.fault)])",
        "del moment",
        (BMC,),
    ),
    Mutant(
        "what a faulting step finds counts",
        "verify/bmc.py",
        "if claim.kind is not ClaimKind.FAULT:",
        "if claim.is_state_property:",
        (BMC,),
    ),
    Mutant(
        "the replay is not consulted",
        "verify/bmc.py",
        "counterexample = judge(recording, claim, moment.phase)",
        'counterexample = Counterexample(recording, moment.configuration.round, moment.phase, "")',
        (PORTFOLIO, ABSTRACTION),
    ),
    Mutant(
        "induction assumes what it is to prove",
        "verify/induction.py",
        "                self._last = taken\n",
        "                self._last = taken\n                self._assumed.append(taken.middle)\n",
        (INDUCTION,),
    ),
    Mutant(
        "induction skips the middle of the round",
        "verify/induction.py",
        "self._asked = [taken.middle, taken.end]",
        "self._asked = [taken.end]",
        (INDUCTION,),
    ),
    Mutant(
        "induction does not look inside the round",
        "verify/induction.py",
        "self._asked.insert(0, taken.inside)",
        "pass",
        (INDUCTION,),
    ),
    Mutant(
        "induction proves what it had no time for",
        "verify/induction.py",
        'return {claim: "timeout" if deadline.is_near() else "too much for the solver"}',
        "return {}",
        (INDUCTION,),
    ),
    Mutant(
        "induction does not mind what it does not cover",
        "verify/induction.py",
        "if step.limits:",
        "if step.limits and not candidates:",
        (INDUCTION,),
    ),
    Mutant(
        "claims that fail stay lemmas",
        "verify/induction.py",
        "failed = step.failing([*given, *candidates], candidates, deadline)",
        "failed = step.failing([*given, *claims], candidates, deadline)",
        (INDUCTION,),
    ),
    Mutant(
        "induction believes what did not replay",
        "verify/engines.py",
        "claims = [c for c in ledger.open() if c not in bounded.unreplayed]",
        "claims = ledger.open()",
        (PORTFOLIO,),
    ),
    Mutant(
        "what did not go far enough passes for holds",
        "verify/ledger.py",
        "not r.reason and _rounds(r) >= self.bounds.rounds",
        "not r.reason",
        (PORTFOLIO,),
    ),
    Mutant(
        "what stopped on the way passes for holds",
        "verify/ledger.py",
        "not r.reason and _rounds(r) >= self.bounds.rounds",
        "_rounds(r) >= self.bounds.rounds",
        (PORTFOLIO, "tests/verify/test_limits.py"),
    ),
    Mutant(
        "claims that hold through some rounds are lemmas for all",
        "verify/ledger.py",
        "return [c for c, v in settled if v.outcome is Outcome.HOLDS and v.rounds is None]",
        "return list(self.claims)",
        (PORTFOLIO,),
    ),
    Mutant(
        "long lists are claimed to be covered",
        "verify/unknowns.py",
        "self.limits.append(limit)",
        "del limit",
        (SYMBOLS, PORTFOLIO),
    ),
    Mutant(
        "equal questions get different answers",
        "verify/unknowns.py",
        "self.constraints.append(self.d.binary(BinaryOp.IMPLIES, same, agree))",
        "del same, agree",
        (SYMBOLS,),
    ),
    Mutant(
        "the axiom of a summary is dropped",
        "verify/unknowns.py",
        "self.constraints += [self._axiom(external, promise) for promise in external.ensures]",
        "pass",
        (SYMBOLS, ABSTRACTION),
    ),
    Mutant(
        "the axiom of a summary is negated",
        "verify/unknowns.py",
        "self.d.binary(BinaryOp.IMPLIES, met, statement(m, promise))",
        "self.d.unary(core.UnaryOp.NOT, statement(m, promise))",
        (SYMBOLS, ABSTRACTION),
    ),
    Mutant(
        "what is written in atomic blocks is never written",
        "syntax/walk.py",
        "elif isinstance(s, core.ForRange | core.ForEach | core.Atomic):",
        "elif isinstance(s, core.ForRange | core.ForEach):",
        (FOOTPRINT,),
    ),
    Mutant(
        "lists keep their length whatever is written",
        "verify/footprint.py",
        "how = Written.PARTS if _inside_list(place) else Written.WHOLE",
        "how = Written.PARTS",
        (FOOTPRINT,),
    ),
    Mutant(
        "who does not ask is never stopped",
        "verify/footprint.py",
        "if asking or _has(agent, core.Stop):",
        "if _has(agent, core.TryStop) or _has(agent, core.Stop):",
        (FOOTPRINT,),
    ),
    Mutant(
        "all opaque values are of one type",
        "verify/abstraction.py",
        "return show(type_)",
        'return "opaque" if show(type_) else ""',
        (ABSTRACTION,),
    ),
    Mutant(
        "a callers duty is looked into by nobody",
        "verify/abstraction.py",
        "for node in nodes((replace(program, externals=()), duties)):",
        "for node in nodes((replace(program, externals=()), duties[:0])):",
        (ABSTRACTION,),
    ),
    Mutant(
        "answers are made up without regard to the summary",
        "verify/concretion.py",
        "if self._meets(original, arguments, candidate):",
        "if self._meets(original, arguments, candidate) or True:",
        (ABSTRACTION,),
    ),
    Mutant(
        "the witness drops the order",
        "verify/witness.py",
        "order = _order(reader, symbolic.before) or tuple(range(system.robots))",
        "order = tuple(range(system.robots))",
        (WITNESS,),
    ),
    Mutant(
        "any two writes that meet are a lost update",
        "semantics/replay.py",
        "if k != other and slot in updates",
        "if k != other",
        (REPLAY,),
    ),
    Mutant(
        "writes that do not meet are a lost update",
        "verify/witness.py",
        "if overlap(EXACT, its_writes.get(slot), other_writes.get(slot)) is not True:",
        "if overlap(EXACT, its_writes.get(slot), other_writes.get(slot)) is None:",
        (WITNESS,),
    ),
    Mutant(
        "what is not broken is shown all the same",
        "verify/witness.py",
        'raise NotReplayedError(f"{claim.name} is not broken where the run ends")',
        "return last",
        (WITNESS,),
    ),
    Mutant(
        "invariants at rounds are asked for everywhere",
        "verify/claims.py",
        "return every or phase not in (Phase.INSIDE, Phase.MIDDLE)",
        "return every or phase is not None",
        (CLAIMS,),
    ),
    Mutant(
        "the environment is not asked about ports",
        "verify/claims.py",
        "if every and phase is Phase.END and not self.reads_ports:",
        "if every and phase is Phase.END:",
        (CLAIMS, BMC),
    ),
    Mutant(
        "one robot stands for two",
        "verify/representatives.py",
        "body=_narrowed(e.body, named + 1, system)",
        "body=_narrowed(e.body, named, system)",
        (REPRESENTATIVES,),
    ),
    Mutant(
        "robots stand for those of other kinds",
        "verify/representatives.py",
        "everyone = (None, system.kinds[0])",
        "everyone = (None, *range(9))",
        (REPRESENTATIVES,),
    ),
    Mutant(
        "robots stand for others wherever they are told apart",
        "verify/representatives.py",
        "if not isinstance(symmetry, Symmetry) or symmetry.groups != everyone:",
        "if not everyone:",
        (REPRESENTATIVES,),
    ),
    Mutant(
        "a step of three rounds rests on one",
        "verify/engines.py",
        "if not claims or bounded.completed is None or bounded.completed < depth - 1:",
        "if not claims or bounded.completed is None:",
        ("tests/verify/test_induction.py",),
    ),
    Mutant(
        "what holds for some rounds is a lemma",
        "verify/ledger.py",
        "if v.outcome is Outcome.HOLDS and v.rounds is None]",
        "if v.outcome is Outcome.HOLDS]",
        (PORTFOLIO,),
    ),
    Mutant(
        "what some robots cannot do nobody can",
        "verify/reaching.py",
        "        pending = [claim for claim in pending if claim in left.claims]\n",
        "        return left\n",
        (PORTFOLIO,),
    ),
    Mutant(
        "cases forget a denial",
        "verify/solving.py",
        "yield from _split(z3.Not(part))",
        "yield from _split(part)",
        (SOLVING,),
    ),
    Mutant(
        "terms divide as the solver does",
        "verify/terms.py",
        "down = z3.If(right > 0, left / right, (-left) / (-right))",
        "down = left / right",
        (TERMS,),
    ),
)

MUTANTS = (
    SEMANTICS + VERIFY + EVERY_N + BITS + LIVENESS + PROTOCOL + WIRE_MISTAKES + DEPLOYED + COMPILED
)
