"""Mistakes in what is said in Koord of invariants of bits, and in the recheck of certificates."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

LEMMAS = "tests/verify/bits/test_lemmas.py"
FOUND = "tests/recheck/test_found.py"
MAPS = "tests/recheck/test_maps.py"
EXAMPLES = "tests/recheck/test_mutations.py"

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
)
