"""Rounds in which nobody acts, many at once: what machine code makes of them is noted afterwards.

Runs are the same to the last bit. Where robots may act :meth:`.Simulation.act` runs their events,
and machine code goes on from there. A round in which a claim may be broken, or anything else is to
be looked at, is made by :meth:`.Simulation.round`. The round in which a robot arrives is the last.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from operator import is_
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from koord.machine.lanes import DOUBLE_BYTES as WORD_BYTES
from koord.runtime.columns.columns import Columns
from koord.runtime.columns.engine import ColumnEngine
from koord.runtime.engine import Deployed
from koord.runtime.motion.arrays import Bools, Floats, Ints
from koord.runtime.motion.group import TICK_S
from koord.runtime.proposals import Decision
from koord.sim.claims import Watching
from koord.sim.gauge_kernel import CompiledGoing
from koord.sim.observing import nothing
from koord.sim.reading import WholeSensors
from koord.sim.running import Simulation
from koord.sim.squad_kernel import FusedDrones, tilts_by
from koord.sim.squads import STEPS
from koord.sim.standing_kernel import CompiledWatchman
from koord.sim.stride_kernel import TABLE, address_of, striding_code
from koord.sim.vehicles.compiled import address
from koord.sim.vehicles.compiled_automata import Table

if TYPE_CHECKING:
    from koord.sim.fleet_kernel import FusedFleet

_Calls: TypeAlias = Sequence[tuple[Callable[..., int], tuple[int, ...]]]

#: At most so many rounds, or rounds of so many robots, are made at once.
_MOST, _MOST_OF_ROBOTS = 32, 20_000

#: A stride of fewer rounds costs more than it saves.
_FEW = 2

#: Where machine code could not end a round so many are made one by one, then twice as many, …
_FIRST_WAIT, _MOST_WAIT = 1, 64

_PLACES = {name: place for place, name in enumerate(TABLE)}


class Strides:
    """What makes rounds of a run, where nobody acts in them."""

    @staticmethod
    def of(run: Simulation) -> Strides | None:
        """What makes rounds of a run; None if there is none for runs of its kind."""
        engine, squad = run.engine, _squads(run)
        sensors = None if run.reader is None else run.reader.whole()
        if type(run) is not Simulation or type(engine) is not ColumnEngine or sensors is None:
            return None
        if engine.fleet is None or squad is None or len(run.cast.kinds) < 2:
            return None
        if type(run.schedule) is not Deployed or engine.has_models or run.host.told_more:
            return None
        if type(run.gauge.going) is not CompiledGoing or run.gauge.has_tasks:
            return None
        if type(run.watchman) is not CompiledWatchman:
            return None
        watching = [one for one in run.claims if type(one) is Watching]
        if len(watching) < len(run.claims) or any(one.glances for one in watching):
            return None
        looks = [one.calls(run) for one in watching]
        guards, columns, kind = engine.fleet.guard_calls(), engine.fleet.columns, run.cast.kinds[0]
        places = [columns.sensed(kind, name) for name, _, _, _ in sensors.places]
        reached = [columns.heard(kind, name) for name, _ in sensors.reached]
        if guards is None or None in looks or None in places or None in reached:
            return None
        ticks = run.scene.delta_s / TICK_S
        if abs(ticks - round(ticks)) > 1e-9 or round(ticks) % 2:
            return None  # states are in two blocks in turn
        of_claims = [call for calls in looks if calls is not None for call in calls]
        squad.room_for(round(ticks))
        parts = _Parts(run, engine, squad, columns, sensors, watching)
        return Strides(parts, guards, of_claims)

    def __init__(self, parts: _Parts, guards: _Calls, looks: _Calls) -> None:
        self._of = parts
        run, columns = parts.run, parts.columns
        going, watchman = run.gauge.going, run.watchman
        assert isinstance(going, CompiledGoing)
        assert isinstance(watchman, CompiledWatchman)
        self._going, self._watchman = going, watchman
        self._count = count = len(run.cast.kinds)
        self._kind = run.cast.kinds[0]
        self._ticks = round(run.scene.delta_s / TICK_S)
        self._most = min(_MOST, _MOST_OF_ROBOTS // count)
        self._wait = self._left = 0
        self._acts_next = False  #: in the next round, as it seems
        self._tilt = bool(run.recorder.recording.header.tilting)
        self._nobody: Bools = np.zeros(count, np.bool_)
        self._squad_table = Table(parts.squad.table_size)
        self._table: Ints = np.zeros(len(TABLE), np.int64)
        self._numbers: Floats = np.zeros(6)  # of a round, what was found, and limits
        self._known: tuple[Any, ...] = ()
        self._were: list[Floats | Bools] = []  #: what robots were told of whether they have arrived
        self._room: NDArray[np.uint8] = np.zeros(0, np.uint8)  #: for states that are kept
        self._held: dict[str, NDArray[Any]] = {}  #: arrays that the table points to
        self._stride = striding_code(parts.squad.moving)
        state: Ints = np.array(columns.state, np.int64)
        # Claims are given all, the state first.
        behind = [(function, given[len(state) :]) for function, given in looks]
        self._set(
            *(("count", count), ("ticks", self._ticks), ("steps", STEPS), ("state", state)),
            *(("guards", _rows(guards)), ("guard_count", len(guards))),
            *(("looks", _rows(behind)), ("look_count", len(looks))),
            *(("tick", address_of(parts.squad.code)), ("squad", self._squad_table.address)),
            *(("measure", address_of(going.code)), ("watch", address_of(watchman.code))),
            *(("moments", self._numbers[0:2]), ("found", self._numbers[2:4])),
            *(("limits", self._numbers[4:6]), ("stopped", self._nobody)),
        )

    def make(self, until_s: float) -> list[Decision]:
        """Make rounds that begin before a time; none where one is to be made by itself."""
        if self._left:
            self._left -= 1
            return []
        if not self._acts_next:
            rounds = self._possible(until_s)
            if rounds < _FEW:
                return []
            made = self._made(rounds, None)
            if made is not None:
                return self._noted(made, rounds, None)
        self._acts_next = False
        return self._acted(until_s)

    def _acted(self, until_s: float) -> list[Decision]:
        """Make a round in which robots may act, and after their events go on by machine code."""
        run = self._of.run
        decision = run.act()
        if self._of.engine.all_go_on(decision):
            run.host.take_orders(run.robots_with_orders())
            self._of.squad.plan(run.fleet.now_s)
            rounds = self._possible(until_s, acts=True)
            made = self._made(rounds, decision) if rounds else None
            if made is not None:
                self._wait = 0
                return self._noted(made, rounds, decision)
        self._left = self._wait = min(max(2 * self._wait, _FIRST_WAIT), _MOST_WAIT)
        return [run.finish()]

    # --- before -------------------------------------------------------------------------------

    def _possible(self, until_s: float, *, acts: bool = False) -> int:
        """How many rounds may be made now: none where something is to be looked at first.

        In the first robots have acted already, if ``acts``, and have given orders.
        """
        run, squad = self._of.run, self._of.squad
        if run.acted or not (run.watchman.is_calm and squad.is_settled):
            return 0
        if any(of.targets or of.plights for of in squad.groups):
            return 0
        if not acts and any(of.orders.any() for of in squad.groups):
            return 0
        if not self._of.engine.all_go_on(run.decision):
            return 0
        if self._going.is_to_be_listed:
            return 0
        delta_s, first, rounds = run.scene.delta_s, run.engine.round, 0
        while rounds < self._most and (first + rounds) * delta_s <= until_s - 1e-9:
            ticks = math.floor((first + rounds + 1) * delta_s / TICK_S + 1e-6)
            if ticks != run.fleet.ticks + (rounds + 1) * self._ticks:
                break
            rounds += 1
        return self._recorded_at_ends(rounds)

    def _recorded_at_ends(self, rounds: int) -> int:
        """How many of the next rounds come before poses are recorded within one."""
        recorder, began = self._of.run.recorder, self._of.run.fleet.ticks
        next_s = recorder.next_s
        for tick in range(1, rounds * self._ticks + 1):
            now_s = (began + tick) * TICK_S
            if now_s >= next_s - 1e-9:
                if tick % self._ticks:
                    return tick // self._ticks
                next_s = now_s + recorder.sample_s
        return rounds

    def _set(self, *entries: tuple[str, Any]) -> None:
        for name, value in entries:
            if isinstance(value, np.ndarray):
                self._held[name] = value
                value = address(value) if value.size else 0
            self._table[_PLACES[name]] = value

    def _point(self, now_s: float) -> None:
        """Point to the arrays that there are now."""
        squad, lingering = self._of.squad, self._watchman.lingering
        arrays = squad.arrays(now_s)
        now = (*arrays.whole, lingering.at)
        if len(now) == len(self._known) and all(map(is_, now, self._known)):
            return
        self._known = now
        self._squad_table.point_to(0, *arrays.whole)
        seen, blocks = [], [(array.ctypes.data, array.nbytes) for array in arrays.written]
        for name, width, told, late in self._of.sensors.places:
            where = self._of.columns.sensed(self._kind, name)
            assert where is not None
            first, rows = where
            seen.append([told.ctypes.data, late.ctypes.data, width, first, rows])
            blocks += [(told.ctypes.data, told.nbytes), (late.ctypes.data, late.nbytes)]
            blocks.append((first, WORD_BYTES * rows * self._count))
        own = self._going.ways_m, lingering.at, lingering.since_s
        blocks += [(array.ctypes.data, array.nbytes) for array in own]
        heard = []
        for name, told in self._of.sensors.reached:
            where = self._of.columns.heard(self._kind, name)
            assert where is not None
            first, rows = where
            heard.append([told.ctypes.data, first, rows])
            blocks += [(told.ctypes.data, told.nbytes), (first, WORD_BYTES * rows * self._count)]
        self._set(
            *(("room", squad.route_room), ("ways", self._going.ways_m)),
            *(("automata", squad.state), ("reached", squad.reached)),
            *(("lingering", lingering.at), ("lingering_s", lingering.since_s)),
            *(("heard", np.array(heard, np.int64)), ("heard_count", len(heard))),
            *(("seen", np.array(seen, np.int64)), ("seen_count", len(seen))),
            *(("kept", self._kept(blocks)), ("kept_count", len(blocks)), ("tilts", arrays.tilts)),
            ("heading", squad.heading),
        )

    def _kept(self, blocks: Sequence[tuple[int, int]]) -> Ints:
        """Rows that say where blocks of memory are kept, by their addresses and sizes."""
        sizes = [WORD_BYTES * (size // WORD_BYTES + 1) for _, size in blocks]
        self._room = np.zeros(sum(sizes), np.uint8)
        to = self._room.ctypes.data + np.cumsum([0, *sizes[:-1]])
        at, size = np.array(blocks, np.int64).T
        return np.ascontiguousarray(np.stack([at, to, size], axis=1))

    # --- rounds -------------------------------------------------------------------------------

    def _made(self, rounds: int, acted: Decision | None) -> _Rounds | None:
        run, count, ticks = self._of.run, self._count, self._ticks
        delta_s, first, began = run.scene.delta_s, run.engine.round, run.fleet.ticks
        times_s = np.array([(began + k) * TICK_S for k in range(rounds * ticks)])
        self._point(float(times_s[0]))
        self._were = [told.copy() for _, told in self._of.sensors.reached]
        ended_s = np.array([(first + k + 1) * delta_s for k in range(rounds)])
        made = _Rounds(
            np.empty((rounds * ticks, count, 3)),
            np.empty((rounds, count)),
            np.empty((rounds, count), np.int64),
            np.empty((rounds, 3, count)),
            np.empty((rounds, count)),
            np.empty(rounds * ticks),
            np.empty(rounds * ticks, np.int64),
            np.empty((rounds, count), np.bool_),
        )
        self._numbers[4:6] = run.scene.safety_m, self._going.reach_m
        pairs, pair_count, since = self._going.listed
        self._set(
            *(("times", times_s), ("began", ended_s - delta_s), ("ended", ended_s)),
            *(("places", made.places), ("short", made.short), ("all_states", made.states)),
            *(
                ("all_tilts", made.tilts),
                ("all_headings", made.headings),
                ("squares", made.squares),
                ("nearest", made.nearest),
                ("all_reached", made.reached),
            ),
            *(("last", self._going.last), ("is_listed", int(self._going.is_listed))),
            *(("pairs", pairs), ("pair_count", pair_count), ("since", since)),
        )
        done = self._stride(self._table.ctypes.data, rounds, int(acted is not None))
        return made.until(done, ticks)

    def _noted(self, made: _Rounds, asked: int, acted: Decision | None) -> list[Decision]:
        """Note what was made of so many rounds that were asked for."""
        of, run, ticks = self._of, self._of.run, self._ticks
        first, done, began = of.engine.round, len(made.states), run.fleet.ticks
        self._acts_next = done < asked
        robots = of.engine.told_robots
        assert run.reader is not None
        if acted is not None:
            of.engine.pass_round(run.reader.pass_idle(made.reached[0], robots, self._were))
            self._were = [told.copy() for _, told in of.sensors.reached]
        decisions = [] if acted is None else [acted]
        order, count = run.schedule.order, self._count
        decisions += [
            Decision(number, (), order(number, count), ())
            for number in range(first + len(decisions), first + done)
        ]
        idle = done if acted is None else done - 1
        at_first = self._going.last
        ended_s = [(began + k + 1) * TICK_S for k in range(done * ticks)]
        distances = np.sqrt(made.squares)
        run.observer.pass_idle(first + done - idle, idle)
        run.gauge.pass_idle(nothing(count), made.states, self._nobody, idle)
        run.gauge.pass_ticks(ended_s, made.places[-1], distances, made.nearest)
        at_ends = slice(ticks - 1, None, ticks)
        poses = np.zeros((done, count, 6), np.float32)
        poses[:, :, :3] = made.places[at_ends]
        poses[:, :, 3] = made.headings
        if self._tilt:
            poses[:, :, 4:] = tilts_by(made.tilts.transpose(1, 0, 2))
        run.observer.pass_ticks(run.fleet, ended_s[at_ends], poses, distances[at_ends])
        of.squad.pass_ticks(len(ended_s), made.places[-1], made.short[-1].copy())
        run.host.pass_idle(done, done * ticks)
        for name, _, _, _ in of.sensors.places:
            of.columns.know(self._kind, name)
        run.reader.pass_sensed(run.host.sensed)
        if idle:
            told = run.reader.pass_idle(made.reached[-1], robots, self._were)
            of.engine.pass_idle(decisions[-1], idle, told)
        places = [at_first, *made.places[ticks - 1 : -1 : ticks]][done - idle :]
        some_go = bool(run.host.sensed.on_the_way.any())
        began_s = run.time_s - run.scene.delta_s
        run.watchman.pass_rounds(done, began_s, run.time_s, some_go=some_go)
        for one in of.watching:
            one.note_sure(done, idle)
        run.pass_idle(decisions, places)
        return decisions


def _squads(run: Simulation) -> FusedDrones | FusedFleet | None:
    """What makes the ticks of all robots; None if there is no machine code that does."""
    squad = run.fleet.only_squad
    if squad is not None:
        return squad if isinstance(squad, FusedDrones) else None
    if not any(placed.model.body.ON_GROUND for placed in run.scene.robots):
        return None  # what vehicles on the ground need is not to be imported
    from koord.sim.fleet_kernel import FusedFleet

    return FusedFleet.of(run.fleet)


class _Parts(Struct, frozen=True, eq=False):
    """What a run is made of, of those whose rounds may be made so."""

    run: Simulation
    engine: ColumnEngine
    squad: FusedDrones | FusedFleet
    columns: Columns
    sensors: WholeSensors
    watching: list[Watching]


class _Rounds(Struct, frozen=True, eq=False):
    """What came of rounds: after each tick, or after each round."""

    places: Floats  #: after each tick, shape ``(k, n, 3)``
    short: Floats  #: how far robots are from their goals, of each round
    states: Ints  #: of automata, of each round
    tilts: Floats  #: what roll and pitch are worked out of, ``(rounds, 3, n)``
    headings: Floats  #: of each round
    squares: Floats  #: of the least distance, after each tick
    nearest: Ints  #: which pair that is
    reached: Bools  #: of each round

    def until(self, done: int, ticks: int) -> _Rounds | None:
        """The same of the first rounds; None if there are none."""
        if not done:
            return None
        by_tick = slice(0, done * ticks)
        return _Rounds(
            self.places[by_tick],
            *(self.short[:done], self.states[:done], self.tilts[:done], self.headings[:done]),
            *(self.squares[by_tick], self.nearest[by_tick], self.reached[:done]),
        )


def _rows(calls: _Calls) -> Ints:
    """Calls as rows of numbers: addresses of functions, and what they are given."""
    rows = [[address_of(function), *given] for function, given in calls]
    return np.array(rows, np.int64).reshape(len(rows), -1) if rows else np.zeros(1, np.int64)
