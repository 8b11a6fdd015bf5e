"""Mistakes in what is said in Koord of invariants of bits, and in the recheck of certificates."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

LEMMAS = "tests/verify/engines/bits/test_invariants.py"
FOUND = "tests/recheck/test_found.py"
MAPS = "tests/recheck/test_maps.py"
EXAMPLES = "tests/recheck/test_mutations.py"
DAMAGE = "tests/recheck/test_damage.py"
EDITS = "tests/recheck/test_edits.py"
OF_EVERYBODY = "tests/recheck/test_every_number.py"
PROGRESS = "tests/recheck/test_progress.py"
FIRST = "tests/recheck/test_first.py"
WRITTEN = "tests/recheck/test_written.py"
SAID = "tests/cli/test_recheck.py"
PROBLEM = "tests/cli/test_problem.py"

CERTIFIED = (
    Mutant(
        "scripts declare functions that other solvers have",
        "verify.encoding.solver.portable",
        "not taken",
        "True",
        (WRITTEN,),
    ),
    # invariants of bits in words
    Mutant(
        "cubes grow into states that are reached",
        "verify.engines.bits.prime_implicants.Primes._is_out",
        "not self._inside.solve([self._inside.of(x) for x in literals])",
        "bool(literals)",
        (LEMMAS,),
    ),
    Mutant(
        "robots that variables hold stay where others move",
        "verify.engines.bits.prime_implicants.PlaceTable._held",
        "not self.places[k].of_robots",
        "k >= 0",
        (LEMMAS,),
    ),
    Mutant(
        "sets of robots that are not spoken of stay",
        "verify.engines.bits.prime_implicants.PlaceTable.orbit",
        "zip([*m, *still[0]], [*new, *still[1]], strict=True)",
        "zip(m, new, strict=True)",
        (LEMMAS,),
    ),
    Mutant(
        "what keeps a part of an invariant is not needed",
        "verify.engines.bits.invariant_core._Core._closed",
        "map(self._broken, sorted(new))",
        "[]",
        (LEMMAS,),
    ),
    Mutant(
        "parts are left out that others need",
        "verify.engines.bits.invariant_core._Core.of",
        "[*goals, *(self._broken(other) for other in sorted(others))]",
        "[*goals]",
        (LEMMAS,),
    ),
    Mutant(
        "ranges are not said",
        "verify.engines.bits.invariants.statements",
        "[*_ranges(found.ranged, table), *clauses]",
        "[*clauses]",
        (LEMMAS,),
    ),
    Mutant(
        "clauses are joined that differ in more than a number",
        "verify.engines.bits.invariants._form",
        "frozenset(parts), clause.alike",
        "clause.alike",
        (LEMMAS,),
    ),
    Mutant(
        "who asked to stop is said to be stopped",
        "verify.engines.bits.invariants._Words._of_robot",
        "stopped == running or (place.moves and (Status.ASKED in held) != running)",
        "stopped == running",
        (LEMMAS,),
    ),
    # maps
    Mutant(
        "what is removed from a map stays",
        "recheck.maps.without",
        "_stored(v, value, key, _none(v, type_), type_)",
        "_entries(v, value, type_)",
        (MAPS,),
    ),
    Mutant(
        "every key is in a map",
        "recheck.maps.has",
        "v.t.op(f\"(_ is {part_name(type_, 'some')})\", [found], BOOL)",
        "v.t.equal(found, found)",
        (MAPS,),
    ),
    Mutant(
        "below a key the rest of an entry is lost",
        "recheck.places.assign",
        "entry_in(body, after, place, locations)",
        "entry_in(body, before, place, locations)",
        (MAPS,),
    ),
    Mutant(
        "maps that race are as the last robot leaves them",
        "recheck.races.Racing.joined",
        "is_flat(type_)",
        "is_flat(type_) or hasattr(type_, 'key')",
        (MAPS,),
    ),
    # steps
    Mutant(
        "the environment's turn is not asked about",
        "recheck.obligations.Obligations._round",
        "round_.environment()",
        "()",
        (EXAMPLES,),
    ),
    # what is claimed, and what is said to be shown
    Mutant(
        "a file calls claims what it likes",
        "recheck.meaning._check_name",
        "claimed.name != right",
        "not right",
        (EXAMPLES,),
    ),
    Mutant(
        "what is claimed need not follow from the invariant",
        "recheck.meaning._argument",
        "consequences.append(replace(own[claimed.name], name=claimed.name))",
        "pass",
        (EDITS,),
    ),
    Mutant(
        "what no run begins with begins anywhere",
        "recheck.checking._Pass.settled",
        "obligations.nothing_begins or one.hollow == NO_START",
        "False",
        (WRITTEN,),
    ),
    Mutant(
        "the subject of a claim does not count",
        "recheck.meaning._argument",
        "claimed.subject",
        '""',
        (EDITS,),
    ),
    Mutant(
        "what is shown for these robots is said of every number",
        "recheck.checking.Rechecked.shown",
        "tuple(s for s in of_rounds if s.claimed.everyone)",
        "tuple(of_rounds)",
        (SAID,),
    ),
    Mutant(
        "digests are not looked at",
        "recheck.certificate._certified",
        'digest_of(text) != reader.field("sha256").text()',
        'not reader.field("sha256").text()',
        (DAMAGE,),
    ),
    Mutant(
        "the invariant is supposed of the start",
        "recheck.obligations.Obligations._starts",
        "self.claims",
        "()",
        (EXAMPLES,),
    ),
    Mutant(
        "params of a certificate are left out",
        "recheck.meaning.elaborated",
        "elaborate(tree, certificate.settings)",
        "elaborate(tree)",
        (SAID,),
    ),
    Mutant(
        "that nothing begins is not known of other configurations",
        "recheck.obligations.Obligations._anything",
        "self.nothing_begins or any(_has_unknown(storage) for storage in kept)",
        "any(_has_unknown(storage) for storage in kept)",
        (SAID,),
    ),
    Mutant(
        "values that are set are not told",
        "syntax.core.Parameter.is_set",
        "self.value != self.written",
        "False",
        (PROBLEM,),
    ),
    # whole runs
    Mutant(
        "places in rings are told of what goes round twice",
        "recheck.values.Values.around",
        "t.plus(count, count)",
        "t.plus(t.plus(count, count), count)",
        ("tests/recheck/test_terms.py",),
    ),
    Mutant(
        "a certified measure may grow",
        "recheck.progress.ProgressObligations._settles",
        "t.at_most(new, old)",
        "t.truth(True)",
        (PROGRESS,),
    ),
    Mutant(
        "a certified measure falls for ever",
        "recheck.progress.ProgressObligations._settles",
        "t.at_most(t.integer(0), old)",
        "t.truth(True)",
        (PROGRESS,),
    ),
    Mutant(
        "a certified statement comes again",
        "recheck.progress.ProgressObligations._settles",
        "t.implies(new, old)",
        "t.truth(True)",
        (PROGRESS,),
    ),
    Mutant(
        "certified locks are granted in vain",
        "recheck.progress.ProgressObligations._granted",
        "t.negation(vain)",
        "t.truth(True)",
        (PROGRESS,),
    ),
    Mutant(
        "certified help is lost",
        "recheck.progress.ProgressObligations._helps",
        'self._goal("it lasts", self._holds(help_.state, self.after, j))',
        "()",
        (PROGRESS,),
    ),
    Mutant(
        "a certified helper is not ready",
        "recheck.progress.ProgressObligations._helps",
        "self._ready(self.before, j)",
        "t.truth(True)",
        (PROGRESS,),
    ),
    Mutant(
        "a certified helper runs for ever",
        "recheck.progress.ProgressObligations._helps",
        "(idle, t.truth(True))",
        "(t.truth(True), t.truth(True))",
        (PROGRESS,),
    ),
    Mutant(
        "what is expected may be so",
        "recheck.progress.ProgressObligations._missed",
        "self.t.negation(kept)",
        "self.t.truth(True)",
        (PROGRESS,),
    ),
    Mutant(
        "nothing has to be owed",
        "recheck.progress.ProgressObligations._owed",
        "self._expected(expected, expected.trigger, state)",
        "(self.t.truth(True), self.t.truth(True))",
        (PROGRESS,),
    ),
    Mutant(
        "time need not pass",
        "recheck.progress.ProgressObligations._falls",
        "t.at_most(new, t.minus(old, least))",
        "t.truth(True)",
        (PROGRESS,),
    ),
    Mutant(
        "what lasts need not follow",
        "recheck.progress.ProgressObligations._follows",
        'self._goal("what lasts", *(self._holds(w, self.before) for w in lasting))',
        "()",
        (PROGRESS,),
    ),
    Mutant(
        "what lasts need not last",
        "recheck.progress.ProgressObligations._lasts",
        'self._goal("what lasts", *(self._holds(w, self.after) for w in lasting))',
        "()",
        (PROGRESS,),
    ),
    Mutant(
        "nobody need help",
        "recheck.progress.ProgressObligations._somebody",
        "t.negation(t.conjunction(nobody))",
        "t.truth(True)",
        (PROGRESS,),
    ),
    Mutant(
        "locks that nobody asks for are not in the order",
        "recheck.progress.ProgressObligations._somebody",
        "[part.index for part in self.argument.order if isinstance(part, LockClass)]",
        "[lock.index for lock in self.program.lock_classes]",
        (PROGRESS,),
    ),
    Mutant(
        "what certified help reads may move",
        "recheck.progress.ProgressObligations._unmoved",
        'self._goal("it is as it was", self._is_as_it_was(part))',
        "()",
        (FIRST,),
    ),
    Mutant(
        "what certified help reads is as it was where it is another",
        "recheck.progress.ProgressObligations._is_as_it_was",
        "t.equal(old, new)",
        "t.truth(True)",
        (FIRST,),
    ),
    Mutant(
        "help reads what is its own alone",
        "recheck.reading.parts_read",
        "node.variable.home is not Home.BOUND",
        "node.variable.home is Home.LOCAL",
        (FIRST,),
    ),
    Mutant(
        "sensors are as they were",
        "recheck.reading.parts_read",
        "node.primed or node.variable.home is Home.PORT",
        "node.primed",
        (FIRST,),
    ),
    Mutant(
        "who ran stays who ran",
        "recheck.reading.parts_read",
        "isinstance(node, _BEYOND)",
        "node in _BEYOND",
        (FIRST,),
    ),
    Mutant(
        "the first of some robots is before itself",
        "recheck.progress.ProgressObligations._first",
        "t.at_most(first, robot)",
        "t.less(first, robot)",
        (FIRST,),
    ),
    Mutant(
        "somebody is the first where there is nobody",
        "recheck.progress.ProgressObligations._first",
        "t.implies(there, is_one(first))",
        "is_one(first)",
        (FIRST,),
    ),
    Mutant(
        "who is first hangs on anything",
        "recheck.progress_meaning._Reading.first",
        "is_plain(state.said) and is_plain(number.said)",
        "state and number",
        (FIRST,),
    ),
    Mutant(
        "what is left of a division is plain",
        "recheck.reading.is_plain",
        "node.op in _DIVISIONS",
        "node.op is None",
        (FIRST,),
    ),
    Mutant(
        "what is expected need not come where nothing moves",
        "recheck.progress_meaning._Reading.help",
        "way.unmoved and way.kind is not HelpKind.ROBOT",
        "False",
        (FIRST,),
    ),
    Mutant(
        "proofs about whole runs are for these robots",
        "recheck.progress_meaning.progress_arguments",
        "all(one.everyone for one in claimed)",
        "claimed",
        (PROGRESS,),
    ),
    Mutant(
        "what is claimed of whole runs need not be proved",
        "recheck.progress_meaning.progress_arguments",
        "[one.name for one in claimed] != list(proofs)",
        "False",
        (PROGRESS,),
    ),
    Mutant(
        "help names what it likes",
        "recheck.progress_meaning._Reading.help",
        "timed != bool(way.falls) or owed != bool(way.assumption)",
        "False",
        (PROGRESS,),
    ),
    Mutant(
        "certificates over two rounds say nothing of the first",
        "recheck.every_number.EveryNumber._over",
        "yield from step",
        "pass",
        (OF_EVERYBODY,),
    ),
    Mutant(
        "certificates over two rounds know the last of them",
        "recheck.every_number.StepObligations._goals",
        "self.asked",
        "()",
        (OF_EVERYBODY,),
    ),
)
