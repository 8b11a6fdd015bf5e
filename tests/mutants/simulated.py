"""Seeded mistakes in what is told of runs, kept of them, and checked of configurations."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

COLUMNS = "tests/sim/test_columns.py"
STANDING = "tests/cli/test_standing.py"
CONFIG = "tests/cli/test_config.py"
CAMPAIGNS = "tests/cli/test_campaigns.py"
RESEEDED = "tests/api/test_reseeding.py"
WORKERS = "tests/api/test_campaign_workers.py"
FIGURES = "tests/api/test_campaign_figures.py"
PARTS = "tests/traces/test_unfinished.py"
RECORDS = "tests/runtime/test_records_parts.py"
PREDICTIVE = "tests/runtime/motion/test_predictive.py"
DRIVEN = "tests/sim/test_compiled_driving.py"
PLANNERS = "tests/sim/test_planning_workers.py"
CONTACT = "tests/sim/test_compiled_contact.py"
ROOM = "tests/sim/test_room.py"
TRACKED = "tests/sim/test_compiled_tracking.py"
PLANNING_TIME = "tests/sim/test_planning_time.py"
LOADERS = "tests/runtime/test_yaml_loaders.py"
SCENES = "tests/runtime/test_scenes.py"

SIMULATED = (
    Mutant(
        "a target without a way leaves no plight",
        "runtime.motion.group.Group._answer",
        "self.plights[robot] = Plight(why, target)",
        "self.plights.pop(robot, None)",
        (STANDING,),
    ),
    Mutant(
        "what leaves no room is held as what does",
        "runtime.motion.predictive._solution",
        "upper - lower < NO_ROOM",
        "upper - lower < 0.0",
        (PREDICTIVE,),
    ),
    Mutant(
        "a car that has its answer goes on while others look for theirs",
        "runtime.motion.predictive._solution",
        "np.where(done, z, limited)",
        "limited",
        (PREDICTIVE,),
    ),
    Mutant(
        "machine code drives cars that are done further",
        "sim.vehicles.compiled_driving._Solver._move",
        "z.where(done, limited)",
        "limited",
        (DRIVEN,),
    ),
    Mutant(
        "sums of machine code leave out the last input",
        "sim.vehicles.compiled_driving._Solver._multiply",
        "word(n - 1)",
        "word(n - 2)",
        (DRIVEN,),
    ),
    Mutant(
        "who simulates does not hand on how many plan",
        "api.simulation.simulate_fitted",
        "request.planners",
        "0",
        (PLANNERS,),
    ),
    Mutant(
        "who plans for others takes another seed",
        "runtime.motion.workers._work",
        "planners[planner].plan(start, goal, seed)",
        "planners[planner].plan(start, goal, seed + 1)",
        (PLANNERS,),
    ),
    Mutant(
        "who plans for others never sees that they are gone",
        "runtime.motion.workers._work",
        "other.close()",
        "pass",
        (PLANNERS,),
    ),
    Mutant(
        "machine code leaves out the last car in contact",
        "sim.vehicles.compiled_contact._blocks",
        "b.add(last, word(width))",
        "last",
        (CONTACT,),
    ),
    Mutant(
        "speeds that others have seen change with cars in contact",
        "sim.vehicles.compiled_contact.CompiledCars.push",
        "cars.speed.copy()",
        "cars.speed",
        (CONTACT,),
    ),
    Mutant(
        "cars that touch nothing by machine code are pushed before they move",
        "sim.vehicles.compiled_contact._write_roam",
        "moved(hull, dt_s, state, forces)",
        "moved(hull, dt_s, [*state[:3], *moved(hull, dt_s, state, forces)[3:]], forces)",
        (CONTACT,),
    ),
    Mutant(
        "two that come towards each other are as far apart as one from a wall",
        "sim.vehicles.room.room_m",
        "math.sqrt(apart2) / 2 - radius_m",
        "math.sqrt(apart2) - 2 * radius_m",
        (ROOM,),
    ),
    Mutant(
        "room is not used up",
        "sim.vehicles.room.Room.suffices",
        "self._left_m -= most_m",
        "self._left_m -= 0.0",
        (ROOM,),
    ),
    Mutant(
        "pymunk is not told where bodies have moved without it",
        "sim.vehicles.contact.Floor.advance",
        "self._is_behind = True",
        "self._is_behind = False",
        (ROOM,),
    ),
    Mutant(
        "machine code lets cars set out before their wheels are turned",
        "sim.vehicles.compiled_tracking._OneCar._turns_wheels",
        "b.and_(b.and_(first, still), wrong)",
        "b.and_(b.and_(b.and_(first, still), wrong), constant(I1, 0))",
        (TRACKED,),
    ),
    Mutant(
        "machine code lets cars go back along their routes",
        "sim.vehicles.compiled_tracking._OneCar.decide",
        "self._nearest(s).greater(s)",
        "self._nearest(s)",
        (TRACKED,),
    ),
    Mutant(
        "answers of cars beside each other are kept for others",
        "sim.vehicles.compiled_tracking._OneCar.take",
        "self._beside('held', row, column)",
        "self._beside('held', row, word(0))",
        (TRACKED,),
    ),
    Mutant(
        "who has missed the end in machine code waits on",
        "sim.vehicles.compiled_tracking._OneCar.send",
        "self.either(missed, zero, waited)",
        "waited",
        (TRACKED,),
    ),
    Mutant(
        "cars that are not steered go on in machine code",
        "sim.vehicles.compiled_tracking._OneCar.send",
        "self.either(going, speed, slowest.greater(0.0))",
        "speed",
        (TRACKED,),
    ),
    Mutant(
        "machine code tells cars the bends of one step further on",
        "sim.vehicles.compiled_tracking._OneCar._predict",
        "word(ERROR_ROWS + steps + 1)",
        "word(ERROR_ROWS + steps)",
        (TRACKED,),
    ),
    Mutant(
        "planning takes no time, whatever a configuration says",
        "runtime.motion.group.Group._ask",
        "now_s + self._takes_s",
        "now_s",
        (PLANNING_TIME,),
    ),
    Mutant(
        "a way to a target is followed although there is a newer one",
        "runtime.motion.group.Group.go_to",
        "self._give_up(robot)",
        "pass",
        (PLANNING_TIME,),
    ),
    Mutant(
        "a way is made of where a robot is when it is there",
        "runtime.motion.group.Group._answer",
        "self._workers.answer(job)",
        "self.planner.plan(Pose(tuple(psn[robot].tolist())), target, job.seed)",
        (PLANNING_TIME,),
    ),
    Mutant(
        "who was stuck once is stuck for ever",
        "sim.standing.Watchman._noted",
        "del self._stuck[pid]",
        "pass",
        (STANDING,),
    ),
    Mutant(
        "of sensors that are read at once only the first coordinates count",
        "sim.reading.Reader.read",
        "differ[3] = differ[2] | moved[:, 2]",
        "differ[3] = differ[1]",
        (COLUMNS,),
    ),
    Mutant(
        "who scans is read once and never again",
        "sim.reading.Reader.read",
        "[robots[pid] for pid in self._alone]",
        "[]",
        (COLUMNS,),
    ),
    Mutant(
        "models have no turn where sensors are read at once",
        "runtime.engine.RoundEngine.environment_turn",
        "self.reader is not None and not self.has_models",
        "self.reader is not None",
        (COLUMNS,),
    ),
    Mutant(
        "orders are carried out of who runs events, not of who ran them before",
        "sim.running.Simulation.__init__",
        "set(range(len(cast.kinds)))",
        "set()",
        (COLUMNS,),
    ),
    Mutant(
        "orders that models give are not carried out",
        "sim.running.Simulation.pass_time",
        "self.engine.has_models or self.host.modules",
        "self.host.modules",
        (COLUMNS,),
    ),
    Mutant(
        "what changes is known of the name before",
        "runtime.monitors._Changes._columns",
        "range(1, len(self.own) + 1)",
        "range(len(self.own))",
        (COLUMNS,),
    ),
    Mutant(
        "a run is still while models change what they write",
        "sim.running.Simulation._is_still",
        "ran or self.engine.has_models",
        "ran",
        (COLUMNS,),
    ),
    Mutant(
        "a run is still while events change variables",
        "sim.running.Simulation.round",
        "bool(decision.ran)",
        "False",
        (COLUMNS,),
    ),
    Mutant(
        "claims hear of what events change at the end of the round",
        "sim.claims.Watching.look",
        "run.acted if moment is WatchPoint.EVENTS else None",
        "() if moment is WatchPoint.EVENTS else None",
        (COLUMNS,),
    ),
    Mutant(
        "claims hear of what events change, and not of what is sensed",
        "sim.claims.Watching.look",
        "run.acted if moment is WatchPoint.EVENTS else None",
        "run.acted",
        (COLUMNS,),
    ),
    Mutant(
        "who stands still ends a run as well as who arrives",
        "cli.sim._concluded",
        "simulated.standing",
        "False",
        (STANDING,),
    ),
    Mutant(
        "deployed runs may begin otherwise than their programs assume",
        "api.deploy_setup.job_of",
        "check_start(fitted)",
        "pass",
        (CONFIG,),
    ),
    Mutant(
        "runs of any campaign go on in a file",
        "api.campaign_runs.RunFile._there",
        "campaign != self._campaign",
        "campaign is None",
        (CAMPAIGNS,),
    ),
    Mutant(
        "runs of a campaign begin with the tasks of the first",
        "api.reseeding.Reseeding.run",
        "self._compiler.classes(fitted.program.core)",
        "self._compiler.classes(self._first.program.core)",
        (RESEEDED,),
    ),
    Mutant(
        "runs of a campaign are told of as the first",
        "api.reseeding.Reseeding._fitted",
        "replace(first, program=program, configuration=configuration, placed=placed)",
        "replace(first, configuration=configuration, placed=placed)",
        (RESEEDED,),
    ),
    Mutant(
        "a list that starts with tasks keeps the length that is assumed",
        "syntax.elaboration.starts.with_tasks",
        "replace(declaration, initial=found, length=None)",
        "replace(declaration, initial=found)",
        (RESEEDED,),
    ),
    Mutant(
        "what a dead worker was at is not made again",
        "api.campaign_workers._by_team",
        "again.extend(batch)",
        "pass",
        (WORKERS,),
    ),
    Mutant(
        "who is blamed for a dead worker was beside others",
        "api.campaign_workers._by_team",
        "[again.popleft()]",
        "[again.popleft() for _ in range(min(2, len(again)))]",
        (WORKERS,),
    ),
    Mutant(
        "each look at an interval may be wrong as often as all together",
        "api.campaign_figures.alpha_of",
        "ALPHA / (look * (look + 1))",
        "ALPHA",
        (FIGURES,),
    ),
    Mutant(
        "equal values end a campaign",
        "api.campaign_figures.Until.is_met",
        "len(values) < FIRST_LOOK or len({*values}) == 1",
        "len(values) < FIRST_LOOK",
        (FIGURES,),
    ),
    Mutant(
        "intervals of rates reach as far on each side as they may on both",
        "api.campaign_figures.rate",
        "1 - alpha / 2",
        "1 - alpha",
        (FIGURES,),
    ),
    Mutant(
        "a campaign ends by the order in which its runs come",
        "api.campaign_course.Course.add",
        "group.rows.get(group.orders[len(group.first)].key)",
        "row if len(group.first) < len(group.rows) else None",
        (FIGURES,),
    ),
    Mutant(
        "a round that was torn is read",
        "traces.unfinished.mended",
        "lines and not _is_whole(lines[-1])",
        "not lines",
        (PARTS,),
    ),
    Mutant(
        "what is cut off counts as whole",
        "api.traces.read_trace",
        "replace(read_trace(whole, name, program), cut_off=True)",
        "replace(read_trace(whole, name, program))",
        (PARTS,),
    ),
    Mutant(
        "what grows has rounds twice",
        "traces.unfinished.GrowingTrace.grow",
        "encode_rounds(trace, self._rounds)",
        "encode_rounds(trace)",
        (PARTS,),
    ),
    Mutant(
        "the tail of a recording stays in it",
        "runtime.records._Stream.tail",
        "self._file.seek(end)",
        "pass",
        (RECORDS,),
    ),
    Mutant(
        "texts that loaders of YAML take differently are left to libyaml",
        "runtime.configuration.loaders.quick_loader",
        "_ODD.search(text)",
        "False",
        (LOADERS,),
    ),
    Mutant(
        "texts with characters that loaders of YAML take differently are left to libyaml",
        "runtime.configuration.loaders.quick_loader",
        "_PRINTABLE.fullmatch(text) is None",
        "False",
        (LOADERS,),
    ),
    Mutant(
        "libyaml has the last word on what is wrong with a configuration",
        "runtime.configuration.reading.read_any",
        "suppress(KoordError)",
        "suppress()",
        (LOADERS,),
    ),
    Mutant(
        "a scene places robots by their order, whatever they are called",
        "runtime.configuration.scenes._matched",
        "not named or len(set(on)) < len(on)",
        "True",
        (SCENES,),
    ),
    Mutant(
        "a car begins where a scene drops it",
        "runtime.configuration.scenes._placed",
        "robot.vehicle.body.ON_GROUND",
        "False",
        (SCENES,),
    ),
    Mutant(
        "robots of a scene look along the x axis",
        "runtime.configuration.scenes._placed",
        "one.heading_rad",
        "0.0",
        (SCENES,),
    ),
)
