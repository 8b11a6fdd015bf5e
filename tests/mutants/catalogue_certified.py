"""Mistakes in what is said in Koord of invariants of bits, and in the recheck of certificates."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

LEMMAS = "tests/verify/bits/test_lemmas.py"
FOUND = "tests/recheck/test_found.py"
MAPS = "tests/recheck/test_maps.py"
EXAMPLES = "tests/recheck/test_mutations.py"
DAMAGE = "tests/recheck/test_damage.py"
EDITS = "tests/recheck/test_edits.py"
SAID = "tests/cli/test_recheck.py"
PROBLEM = "tests/cli/test_problem.py"

CERTIFIED = (
    # invariants of bits in words
    Mutant(
        "cubes grow into states that are reached",
        "verify/bits/primes.py",
        "return not self._inside.solve([self._inside.of(x) for x in literals])",
        "return bool(literals)",
        (LEMMAS,),
    ),
    Mutant(
        "robots that variables hold stay where others move",
        "verify/bits/primes.py",
        "if not self.places[k].of_robots:",
        "if k >= 0:",
        (LEMMAS,),
    ),
    Mutant(
        "sets of robots that are not spoken of stay",
        "verify/bits/primes.py",
        "to |= dict(zip([*m, *still[0]], [*new, *still[1]], strict=True))",
        "to |= dict(zip(m, new, strict=True))",
        (LEMMAS,),
    ),
    Mutant(
        "what keeps a part of an invariant is not needed",
        "verify/bits/minimal.py",
        "pending += map(self._broken, sorted(new))",
        "pending += []",
        (LEMMAS,),
    ),
    Mutant(
        "parts are left out that others need",
        "verify/bits/minimal.py",
        "asked = [*goals, *(self._broken(other) for other in found if other != k)]",
        "asked = [*goals]",
        (LEMMAS,),
    ),
    Mutant(
        "ranges are not said",
        "verify/bits/saying.py",
        "clauses = _over_numbers([*_ranges(found.ranged, table), *clauses], table)",
        "clauses = _over_numbers([*clauses], table)",
        (LEMMAS,),
    ),
    Mutant(
        "clauses are joined that differ in more than a number",
        "verify/bits/saying.py",
        "return tuple(sorted(parts, key=str)), clause.alike",
        "return clause.alike",
        (LEMMAS,),
    ),
    Mutant(
        "who asked to stop is said to be stopped",
        "verify/bits/saying.py",
        "if stopped == running or (place.moves and (Status.ASKED in held) != running):",
        "if stopped == running:",
        (LEMMAS,),
    ),
    # maps
    Mutant(
        "what is removed from a map stays",
        "recheck/maps.py",
        "return _made(v, type_, _stored(v, value, key, _none(v, type_), type_), fewer)",
        "return _made(v, type_, _entries(v, value, type_), fewer)",
        (MAPS,),
    ),
    Mutant(
        "every key is in a map",
        "recheck/maps.py",
        "return v.t.op(f\"(_ is {_name(type_, 'some')})\", [found], BOOL)",
        "return v.t.equal(found, found)",
        (MAPS,),
    ),
    Mutant(
        "below a key the rest of an entry is lost",
        "recheck/places.py",
        "value = entry_in(body, after, place, locations)",
        "value = entry_in(body, before, place, locations)",
        (MAPS,),
    ),
    Mutant(
        "maps that race are as the last robot leaves them",
        "recheck/racing.py",
        "case ListType() | QueueType() | MapType():",
        "case ListType() | QueueType():",
        (MAPS,),
    ),
    # steps
    Mutant(
        "the environment's turn is not asked about",
        "recheck/obligations.py",
        "yield from round_.environment()",
        "yield from ()",
        (EXAMPLES,),
    ),
    # what is claimed, and what is said to be shown
    Mutant(
        "a file calls claims what it likes",
        "recheck/statements.py",
        "if claimed.name != right:",
        "if not right:",
        (EXAMPLES,),
    ),
    Mutant(
        "what is claimed need not follow from the invariant",
        "recheck/opening.py",
        "consequences.append(replace(own[claimed.name], name=claimed.name))",
        "pass",
        (EDITS,),
    ),
    Mutant(
        "the subject of a claim does not count",
        "recheck/opening.py",
        "claims.append(Claim(claimed.name, claimed.kind, None, claimed.subject, depth))",
        'claims.append(Claim(claimed.name, claimed.kind, None, "", depth))',
        (EDITS,),
    ),
    Mutant(
        "what is shown for these robots is said of every number",
        "recheck/checking.py",
        "everyone = tuple(s for s in self.about.statements if s.claimed.everyone)",
        "everyone = self.about.statements",
        (SAID,),
    ),
    Mutant(
        "digests are not looked at",
        "recheck/certificate.py",
        'if digest_of(text) != reader.field("sha256").text():',
        'if not reader.field("sha256").text():',
        (DAMAGE,),
    ),
    Mutant(
        "the invariant is supposed of the start",
        "recheck/obligations.py",
        "goals = self.goals(opening.state, self.claims, between_rounds=True)",
        "goals = self.goals(opening.state, (), between_rounds=True)",
        (EXAMPLES,),
    ),
    Mutant(
        "params of a certificate are left out",
        "recheck/opening.py",
        "elaborated = elaborate(tree, certificate.settings)",
        "elaborated = elaborate(tree)",
        (SAID,),
    ),
    Mutant(
        "that nothing begins is not known of other configurations",
        "recheck/obligations.py",
        "if self.nothing_begins or any(_has_unknown(storage) for storage in kept):",
        "if any(_has_unknown(storage) for storage in kept):",
        (SAID,),
    ),
    Mutant(
        "values that are set are not told",
        "syntax/core.py",
        "return self.value != self.written",
        "return False",
        (PROBLEM,),
    ),
)
