"""IC3, also called PDR: an invariant of a circuit found clause by clause, for all rounds.

Frame k is a set of clauses that hold of every state after at most k rounds. A state of the last
frame that breaks a claim is an *obligation*: it is excluded by a clause, with what led to it if
need be, or led back to INIT. When two frames are alike, they are an invariant. See Een, Mishchenko,
Brayton, *Efficient implementation of property directed reachability* (2011).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from heapq import heappop, heappush

from msgspec import Struct, field

from koord.verify.effort import Deadline
from koord.verify.engines.bits.circuit import Latch
from koord.verify.engines.bits.clauses import QUICK, TRUE_SIDE, Clauses, NoAnswerError
from koord.verify.engines.bits.graph import Graph

#: Literals of a cube are numbers of latches from 1 on, negative where the latch is false.
Cube = tuple[int, ...]


class SafetyQuery(Struct, frozen=True):
    """A safety query: whether ``bad`` can ever hold. All fields are literals of the graph.

    ``given`` holds of every state that can be reached, as was shown before, and so does
    ``in_range`` by the making of the circuit: it need not be shown of what leads to a bad state.
    ``kept`` holds of every state as long as nothing was bad: it is part of each invariant.
    """

    latches: tuple[Latch, ...]
    opens: int
    steps: int
    bad: int
    given: tuple[int, ...] = ()
    in_range: tuple[int, ...] = ()
    kept: tuple[int, ...] = ()


class ClauseInvariant(Struct, frozen=True):
    """An inductive invariant that excludes ``bad``: clauses, as cubes of unreachable states.

    With what the query calls ``kept``.
    """

    cubes: tuple[Cube, ...]
    rounds: int  #: frames that were needed


class Reached(Struct, frozen=True):
    """The result that ``bad`` can hold in the round with that number, counted from 1."""

    rounds: int


class Unfinished(Struct, frozen=True):
    """The result that time ran out; ``bad`` does not hold in so many rounds."""

    rounds: int


class Ic3Run(Struct):
    """A run of IC3.

    ``images`` gives what a cube becomes when robots change places; None if that is not to be said
    of it in cubes. Images of what is excluded are excluded as well, unasked as long as all that was
    learned has images, for then frames are symmetric.
    """

    clauses: Clauses
    question: SafetyQuery
    deadline: Deadline
    images: Callable[[Cube], Iterable[Cube] | None] = lambda cube: None
    progress: Callable[[int, int], None] = lambda frame, cubes: None
    limit: int | None = None  #: so many questions are asked at most
    frame_limit: int | None = None  #: so many until there is another frame
    frames: list[set[Cube]] = field(default_factory=list)
    queries: int = 0
    _opened: int = 0  #: the questions that were asked before the last frame
    _enabled: list[int] = field(default_factory=list)  #: per frame, the literal that turns it on
    _latch: list[int] = field(default_factory=list)
    _next: list[int] = field(default_factory=list)
    _inputs: list[int] = field(default_factory=list)
    _step: int = 0
    _bad: list[int] = field(default_factory=list)  #: ways to be bad, literals of the graph
    _reset: _Start | None = None
    _lifting: _Lifting | None = None
    _first: dict[int, bool] = field(default_factory=dict)  #: what latches are after INIT, if known
    _counter: int = 0
    _spent: int = 0
    _orbit: dict[Cube, tuple[Cube, ...]] = field(default_factory=dict)
    _primed: dict[Cube, int] = field(default_factory=dict)
    _lopsided: bool = False  #: whether something without images was learned
    _depth: int = 0
    _weight: dict[int, float] = field(default_factory=dict)

    def run(self) -> ClauseInvariant | Reached | Unfinished:
        """Find an invariant, or the number of rounds to a bad state."""
        try:
            return self._found()
        except NoAnswerError:
            return Unfinished(max(0, len(self.frames) - 1))

    def _found(self) -> ClauseInvariant | Reached | Unfinished:
        self._prepare()
        frame = 0
        while True:
            self.queries += 1
            # One by one: many easy questions are quicker than a hard one. What a frame has
            # excluded stays excluded from it.
            for way in self._bad:
                while (found := self._bad_state(frame, way)) is not None:
                    if not self._blocked(found, frame):
                        return Reached(self._depth)
                    if self._is_over():
                        return Unfinished(frame)
            if self._is_over():
                return Unfinished(frame)
            frame += 1
            self._open_frame()
            self.progress(frame, sum(map(len, self.frames)))
            fixed = self._pushed(frame)
            if fixed is not None:
                return ClauseInvariant(tuple(sorted(fixed)), frame)
            if self._is_over():
                return Unfinished(frame)

    def _is_over(self) -> bool:
        if self.limit is not None and self.queries > self.limit:
            return True
        if self.frame_limit is not None and self.queries - self._opened > self.frame_limit:
            return True
        return self.deadline.passed()

    # --- set-up ---------------------------------------------------------------------------------

    def _prepare(self) -> None:
        clauses, question = self.clauses, self.question
        for latch in question.latches:
            self._latch.append(clauses.of(latch.literal))
            self._next.append(clauses.of(latch.next))
        self._step = clauses.of(question.steps, TRUE_SIDE)
        self._bad = _ways(clauses.graph, question.bad)
        for way in self._bad:
            clauses.of(way, TRUE_SIDE)
        # A run to the first bad state has none before: all its states keep what is kept.
        for literal in (*question.given, *question.in_range, *question.kept):
            clauses.require(literal)
        self._first = {
            k + 1: bool(latch.init) for k, latch in enumerate(question.latches) if latch.init < 2
        }
        self._reset = _Start(clauses.graph, question)
        self._lifting = _Lifting(clauses.graph, question)
        # Frame 0 is INIT itself.
        start = clauses.variable()
        opens = clauses.of(question.opens, TRUE_SIDE)
        clauses.add([-start, opens])
        for number, latch in zip(self._latch, question.latches, strict=True):
            first = clauses.of(latch.init)
            clauses.add([-start, -number, first])
            clauses.add([-start, number, -first])
        self._enabled.append(start)
        self.frames.append(set())

    def _open_frame(self) -> None:
        self._enabled.append(self.clauses.variable())
        self.frames.append(set())
        self._opened = self.queries

    def _on(self, frame: int) -> list[int]:
        """The assumptions that activate a frame. Clauses of later frames hold in it too."""
        return [self._enabled[0]] if frame == 0 else self._enabled[frame:]

    # --- questions ------------------------------------------------------------------------------

    def _bad_state(self, frame: int, way: int) -> Cube | None:
        """A cube of states of a frame that are bad in one way, or None."""
        if not self.clauses.solve([*self._on(frame), self.clauses.of(way, TRUE_SIDE)]):
            return None
        self.queries += 1
        assert self._lifting is not None
        return self._lifting.bad(self.clauses, self._latch, way)

    def _leads_to(self, frame: int, cube: Cube, *, but: bool = True) -> Cube | None:
        """None if a state of the frame leads to the cube, else the part of the cube in the core.

        With ``but``, states of the cube itself do not count.
        """
        self.queries += 1
        if self._spent:
            self.clauses.add([-self._spent])
        assumptions = self._on(frame)
        extra = 0
        if but and frame:
            extra = self.clauses.variable()
            self.clauses.add([-extra, *(-self._number(x) for x in cube)])
            assumptions = [*assumptions, extra]
        then = {self._then(x): x for x in cube}
        reached = self.clauses.solve([*assumptions, self._step, *then])
        # Whoever asks may want the model, which the next clause makes the solver forget.
        self._spent = extra
        if reached:
            return None
        core = self.clauses.core()
        kept = tuple(sorted(then[x] for x in core if x in then))
        return kept

    def _number(self, x: int) -> int:
        number = self._latch[abs(x) - 1]
        return number if x > 0 else -number

    def _then(self, x: int) -> int:
        number = self._next[abs(x) - 1]
        return number if x > 0 else -number

    # --- blocking -------------------------------------------------------------------------------

    def _blocked(self, cube: Cube, frame: int) -> bool:
        """Block a cube in a frame. Return False if a run from INIT leads to it."""
        queue: list[tuple[int, int, Cube, int]] = []
        self._push(queue, frame, cube, 1)
        while queue:
            if self._is_over():
                return True
            level, _, wanted, distance = heappop(queue)
            if level == 0 or self._starts_in(wanted):
                self._depth = distance
                return False
            if self._is_excluded(wanted, level):
                continue
            enough = self._leads_to(level - 1, wanted)
            if enough is None:
                assert self._lifting is not None
                before = self._lifting.before(self.clauses, self._latch, wanted)
                self._push(queue, level - 1, before, distance + 1)
                self._push(queue, level, wanted, distance)
                continue
            smaller = self._generalised(self._apart(enough, wanted), level)
            level_of = self._as_late_as_possible(smaller, level)
            self._learn(smaller, level_of)
            if level_of < frame:
                self._push(queue, level_of + 1, wanted, distance)
        return True

    def _push(
        self, queue: list[tuple[int, int, Cube, int]], level: int, cube: Cube, distance: int
    ) -> None:
        self._counter += 1
        heappush(queue, (level, self._counter, cube, distance))

    def _is_excluded(self, cube: Cube, level: int) -> bool:
        """Return whether a clause of the frame excludes the whole cube."""
        literals = set(cube)
        return any(literals.issuperset(other) for frame in self.frames[level:] for other in frame)

    def _generalised(self, cube: Cube, level: int, depth: int = 0) -> Cube:
        """Generalise a cube: a small part of it that the frame before does not lead to either."""
        order = sorted(cube, key=lambda x: (self._weight.get(x, 0.0), x))
        tried = 0
        for x in order:
            if x not in cube or len(cube) == 1:
                continue
            without = tuple(y for y in cube if y != x)
            smaller = self._dropped(without, level, depth)
            if smaller is not None:
                cube = smaller
            else:
                tried += 1
                if tried > MISSES and depth:
                    break
        return cube

    def _dropped(self, cube: Cube, level: int, depth: int) -> Cube | None:
        """Try to drop a literal: the cube or a part of it, if it (or more cubes) can be blocked."""
        counter = 0
        while True:
            if self._starts_in(cube):
                return None
            enough = self._leads_to(level - 1, cube)
            if enough is not None:
                return self._apart(enough, cube)
            if depth or counter >= OBSTACLES or level < 2:
                return None
            assert self._lifting is not None
            obstacle = self._lifting.before(self.clauses, self._latch, cube)
            if self._starts_in(obstacle):
                return None
            part = self._leads_to(level - 2, obstacle)
            if part is None:
                return None
            part = self._apart(part, obstacle)
            where = level - 1
            part = self._generalised(part, where, depth + 1)
            self._learn(part, self._as_late_as_possible(part, where))
            counter += 1

    def _as_late_as_possible(self, cube: Cube, level: int) -> int:
        """The last frame in which a cube can be blocked."""
        while level < len(self.frames) - 1 and self._leads_to(level, cube) is not None:
            level += 1
        return level

    def _apart(self, enough: Cube, cube: Cube) -> Cube:
        """A part of a cube with at least these literals that contains no initial state."""
        if not self._starts_in(enough):
            return enough
        assert self._reset is not None
        for x in cube:
            if x in self._first_not(x):
                return tuple(sorted({*enough, x}))
        return tuple(sorted({*enough, *self._reset.why_not(cube)}))

    def _first_not(self, x: int) -> tuple[int, ...]:
        first = self._first.get(abs(x))
        return (x,) if first is not None and first != (x > 0) else ()

    def _starts_in(self, cube: Cube) -> bool:
        """Return whether a state after INIT may be in a cube."""
        if any(self._first_not(x) for x in cube):
            return False
        assert self._reset is not None
        return self._reset.meets(cube)

    # --- clauses --------------------------------------------------------------------------------

    def _learn(self, cube: Cube, level: int) -> None:
        """Block a cube in a frame and all before it, with its images under renaming of robots."""
        if self._is_excluded(cube, level):
            return
        literals = set(cube)
        for frame in self.frames[1 : level + 1]:
            frame -= {other for other in frame if literals.issubset(other)}
        for x in cube:
            self._weight[x] = self._weight.get(x, 0.0) + 1.0
        self._add(cube, level)
        images = self.images(cube)
        if images is None:
            self._lopsided = True
            return
        orbit = (cube, *images)
        new = [x for x in orbit[1:] if all(x not in frame for frame in self.frames[level:])]
        if self._lopsided:
            new = self._kept_out([x for x in new if not self._starts_in(x)], level)
        for image in orbit:
            self._orbit[image] = orbit
        for image in new:
            self._add(image, level)

    def _kept_out(self, cubes: Sequence[Cube], level: int) -> list[Cube]:
        """The cubes that the frame before does not lead to, as far as a quick check tells."""
        left = list(cubes)
        for _ in range(PATIENCE):
            if not left:
                break
            self.queries += 1
            reached = [self._reached(cube) for cube in left]
            one = self.clauses.variable()
            self.clauses.add([-one, *reached])
            some = self.clauses.solve([*self._on(level - 1), self._step, one])
            model = self.clauses.model() if some else []
            self.clauses.add([-one])
            if not some:
                return left
            left = [c for c, number in zip(left, reached, strict=True) if model[number] < 0]
        return []

    def _reached(self, cube: Cube) -> int:
        """The literal that a round leads to a cube."""
        number = self._primed.get(cube)
        if number is None:
            number = self._primed[cube] = self.clauses.variable()
            for x in cube:
                self.clauses.add([-number, self._then(x)])
        return number

    def _add(self, cube: Cube, level: int) -> None:
        for frame in self.frames[1:level]:
            frame.discard(cube)
        self.frames[level].add(cube)
        self.clauses.add([-self._enabled[level], *(-self._number(x) for x in cube)])

    def _pushed(self, last: int) -> set[Cube] | None:
        """Push clauses to later frames. Return the invariant if two frames are equal."""
        for level in range(1, last):
            stay: set[Cube] = set()
            for cube in sorted(self.frames[level], key=len):
                if cube not in self.frames[level] or cube in stay:
                    continue
                orbit = [c for c in self._orbit.get(cube, ()) if c in self.frames[level]]
                # Where all that is known has images, what holds of one of them holds of all.
                if self._leads_to(level, cube, but=False) is None:
                    stay.update(() if self._lopsided else orbit)
                    continue
                alike = self._kept_out(orbit, level + 1) if self._lopsided else orbit
                for other in {cube, *alike}:
                    self._add(other, level + 1)
            if not self.frames[level]:
                return set().union(*self.frames[level + 1 :])
        return None


def _ways(g: Graph, bad: int) -> list[int]:
    """Some ways to be bad, which are all together; several in one where there are many."""
    ways = [way ^ 1 for way in g.conjuncts(bad ^ 1)]
    size = -(-len(ways) // MOST_WAYS)
    return [g.any_of(ways[k : k + size]) for k in range(0, len(ways), max(1, size))]


#: So many ways to be bad are looked at one by one.
MOST_WAYS = 400

#: So often what some images are reached by is looked at.
PATIENCE = 6

#: So many literals that cannot be left out are enough in a minor cube.
MISSES = 6

#: So many states that stand in the way of a smaller cube are looked at.
OBSTACLES = 3


class _Start:
    """A solver for the initial states."""

    def __init__(self, graph: Graph, question: SafetyQuery) -> None:
        self.question = question
        self.clauses = Clauses(graph, QUICK)
        self.clauses.require(question.opens)
        self._then = [self.clauses.of(latch.init) for latch in question.latches]
        self._met: dict[Cube, bool] = {}

    def meets(self, cube: Cube) -> bool:
        return self.clauses.solve([self._signed(x) for x in cube])

    def why_not(self, cube: Cube) -> Cube:
        """Literals of a cube that no initial state has together."""
        signed = {self._signed(x): x for x in cube}
        met = self.clauses.solve(list(signed))
        assert not met
        return tuple(signed[x] for x in self.clauses.core())

    def _signed(self, x: int) -> int:
        number = self._then[abs(x) - 1]
        return number if x > 0 else -number


class _Lifting:
    """A solver for lifting: the part of a state that suffices for its successor."""

    def __init__(self, g: Graph, q: SafetyQuery) -> None:
        self.question = q
        self.clauses = Clauses(g, QUICK)
        self._latch = [self.clauses.of(latch.literal) for latch in q.latches]
        self._next = [self.clauses.of(latch.next) for latch in q.latches]
        own = {latch.literal >> 1 for latch in q.latches}
        roots = [q.steps, q.bad, *(latch.next for latch in q.latches)]
        self._inputs = [
            (node, self.clauses.of(2 * node))
            for node in g.cone(roots)
            if g.is_input(node) and node not in own
        ]

    def bad(self, of: Clauses, latches: list[int], way: int) -> Cube:
        """The part of the state in the last model that suffices to be bad in one way."""
        return self._enough(of, latches, [self.clauses.of(way)])

    def before(self, of: Clauses, latches: list[int], cube: Cube) -> Cube:
        """The part of the state in the last model that suffices to lead to a cube."""
        goal = [self.clauses.of(self.question.steps)]
        goal += [self._next[abs(x) - 1] * (1 if x > 0 else -1) for x in cube]
        return self._enough(of, latches, goal)

    def _enough(self, of: Clauses, latches: list[int], goal: list[int]) -> Cube:
        model = of.model()
        state = {}
        for k, number in enumerate(latches):
            true = model[abs(number)] * (1 if number > 0 else -1) > 0
            state[self._latch[k] if true else -self._latch[k]] = k + 1 if true else -(k + 1)
        inputs = []
        for node, number in self._inputs:
            there = of.known(node)
            if there is not None:
                inputs.append(number if model[there] > 0 else -number)
        off = self.clauses.variable()
        self.clauses.add([-off, *(-x for x in goal)])
        met = self.clauses.solve([off, *inputs, *state])
        assert not met
        core = self.clauses.core()
        self.clauses.add([-off])
        return tuple(sorted(state[x] for x in core if x in state))


def reduced(
    latches: Sequence[Latch], cone: Callable[[Iterable[int]], list[int]], roots: Iterable[int]
) -> tuple[Latch, ...]:
    """The latches that literals depend on, now or later (the cone of influence)."""
    by_node = {latch.literal >> 1: latch for latch in latches}
    found: dict[int, Latch] = {}
    pending = list(roots)
    while pending:
        nodes = cone(pending)
        new = [by_node[n] for n in nodes if n in by_node and n not in found]
        found |= {latch.literal >> 1: latch for latch in new}
        pending = [latch.next for latch in new]
    return tuple(latch for latch in latches if latch.literal >> 1 in found)
