"""Checking of configuration files, with a diagnostic for every mistake."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from ipaddress import AddressValueError, IPv4Address

import msgspec

from koord.runtime.configuration.forms import (
    Agent,
    Carrier,
    Coordinates,
    Device,
    Form,
    Motion,
    NetworkForm,
    ObstacleForm,
    WorldForm,
)
from koord.runtime.configuration.keys import HINT, weakness
from koord.runtime.configuration.locating import stated_localiser
from koord.runtime.configuration.model import (
    MotionAutomaton,
    RobotPlace,
    RunConfiguration,
    Scatter,
    Talk,
    Vehicle,
)
from koord.runtime.configuration.other_files import misread
from koord.runtime.configuration.planner_names import planner_named
from koord.runtime.configuration.plug_ins import plugged
from koord.runtime.configuration.published import adopted, automata_of, taken_otherwise
from koord.runtime.configuration.reading import Document, Path, problem, read, with_site
from koord.runtime.configuration.safety import safety_flaws, stated_safety
from koord.runtime.configuration.topics import (
    PUBLISHED,
    ROS_DRIVERS,
    ROS_OPTIONS,
    driver_of,
    names_topics,
    topic_word,
    topics,
)
from koord.runtime.configuration.typed import FormReader
from koord.runtime.guardian.limits import SafetyLimits
from koord.runtime.motion.bodies import VEHICLES, PlannerName
from koord.runtime.motion.world import Box, Disc, Obstacle, Point, Polygon, World
from koord.syntax.collector import uncollected
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import Source, Span

DEFAULT_PORT = 61_820

_PUBLISHED_AUTOMATA = [one.value for one in MotionAutomaton]

#: In the block of addresses that any organisation may use for itself.
DEFAULT_GROUP = "239.255.75.1"

#: Fields of the published middleware that are read, and change nothing; and what does.
_IDLE: Mapping[str, str] = {
    "mutex_handler": "robots that enter one lock class are kept apart by the protocol",
    "nbr_pids": "every robot talks with all others",
    "plist": "a robot listens on the `port` of its device",
} | dict.fromkeys(ROS_OPTIONS, "it is for drivers that speak ROS: `driver: ros1`, `ros2`")


#: Where a `safety:` block changes nothing either.
_UNGUARDED = "ideal points and the robots of simulations have no guardian"

_SAFETY_HINT = "specs/guardian/README.md says what the limits are for"


@uncollected()
def load(source: Source, site: Source | None = None) -> RunConfiguration:
    """Load a configuration from a text, and what it does not say from that of a site. (P-SITE)

    Raises KoordError with all mistakes.
    """
    try:
        document = read(source)
        if site is not None:
            document = with_site(document, read(site))
        return checked(document)
    except KoordError:
        told = [one for text in (source, site) if text is not None for one in misread(text)]
        if told:
            raise KoordError(tuple(told)) from None
        raise


def checked(document: Document) -> RunConfiguration:
    """The configuration that a document is. Raises KoordError with all mistakes."""
    checker = _Checker(document)
    form = checker.form()
    if checker.problems:
        raise KoordError(tuple(checker.problems))
    configuration = checker.configuration(form)
    if checker.problems or configuration is None:
        raise KoordError(tuple(checker.problems))
    return configuration


class _Checker(FormReader):
    """Checks what types do not say, and makes the configuration."""

    def __init__(self, document: Document) -> None:
        super().__init__(document)
        #: By name, place and motion automaton: robots on one device share one.
        self._vehicles: dict[tuple[str, Path, str | None], Vehicle] = {}
        self._first = 0  #: the pid in the file of robot 0
        self._places: dict[str, Path] = {}  #: of devices, by their names
        self._warnings: list[Diagnostic] = []

    # --- sense ----------------------------------------------------------------------------------

    def configuration(self, form: Form) -> RunConfiguration | None:
        made = adopted(form, self._document)
        form = made.form
        self._first, self._places = made.first, made.devices
        self._warnings += made.warnings
        agents = self._agents(form, made.agents)
        world = None if form.world is None else self._world(form.world)
        talk = self._talk(form)
        if self.problems:
            return None
        robots = tuple(self._robot(form, agent, path, talk, world) for agent, path in agents)
        self._check_addresses(form, robots)
        self._check_topics(robots)
        if not 0 <= form.leader_pid < len(robots):
            self._say(("leader_pid",), f"there is no robot {form.leader_pid + made.first}")
        for pid in form.positions:
            if not 0 <= pid < len(robots):
                written = pid + made.first
                self._say(("positions", written), f"there is no robot {written}")
        return RunConfiguration(
            self._document.source.name,
            robots,
            talk,
            world,
            form.delta,
            form.seed,
            form.leader_pid,
            form.params,
            self._scatter(form.world, world),
            form.world is not None and form.world.bounds is not None,
            form.monitor,
            form.radio,
            self._document,
            (*self._warnings, *self._idle()),
        )

    def _idle(self) -> Iterator[Diagnostic]:
        """Warn of each kind of field that has no effect, at its first place. (K938)"""
        places: dict[str, Span] = {}
        for path, span in self._document.names.items():
            if path[-1] in ROS_OPTIONS and self._speaks_ros(path):
                continue
            if path[0] != "params" and path[-1] in _IDLE:
                places.setdefault(str(path[-1]), span)
            elif path[-1] == "safety" and self._is_unguarded(path):
                places.setdefault("safety", span)
        for name, span in places.items():
            is_idle = name in _IDLE
            story = (
                f"`{name}` has {'no effect' if is_idle else 'an effect on driven vehicles alone'}"
            )
            hint = _IDLE.get(name, _UNGUARDED)
            yield Diagnostic("K938", Severity.WARNING, span, story, hint)

    def _is_unguarded(self, path: Path) -> bool:
        """Return whether limits are of devices none of which has a driver."""
        at = self._document.value
        if path == ("safety",):
            listed = at.get("devices") or at.get("bots") or {}
            listed = listed.values() if isinstance(listed, dict) else listed
            devices = [at.get("device"), *listed]
        elif path[0] in ("device", "devices", "bots"):
            for step in path[:-1]:
                at = at[step]
            devices = [at]
        else:
            return False
        return not any(isinstance(one, dict) and "driver" in one for one in devices)

    def _speaks_ros(self, path: Path) -> bool:
        """Return whether a field belongs to a device whose driver speaks ROS."""
        device = self._document.value
        for step in path[: 1 if path[0] == "device" else 2]:
            device = dict(enumerate(device)) if isinstance(device, list) else device
            device = device.get(step) if isinstance(device, dict) else None
        if not isinstance(device, dict):
            return False
        driver = device.get("driver", PUBLISHED if names_topics(device) else None)
        return driver in ROS_DRIVERS

    def _agents(self, form: Form, places: tuple[Path, ...]) -> list[tuple[Agent, Path]]:
        """The robots by pid, and their places in the file."""
        if form.agents and (form.robot is not None or form.num_robots is not None):
            hint = "`robot`, `device` and `num_robots` are one form, `agents` and `devices` another"
            self._say(("agents",), "the robots are given in two forms", hint)
            return []
        if form.agents:
            return self._numbered(form.agents, places)
        if form.num_robots is None and "agents" in self._document.value:
            hint = "a run has at least one robot, as in agents: [{pid: 0}]"
            self._say(("agents",), "there is no robot in this file: `agents` is empty", hint)
            return []
        if form.num_robots is None:
            path: Path = ("robot",) if form.robot is not None else ()
            self._say(path, "it is not said how many robots there are", "write num_robots: 3")
            return []
        return [(self._copied(form.robot, pid), ("robot",)) for pid in range(form.num_robots)]

    def _copied(self, robot: Agent | None, pid: int) -> Agent:
        """Copies of the one robot that is described, with different starts."""
        if robot is None:
            return Agent(pid=pid)
        position = robot.position if robot.pid == pid else None
        return msgspec.structs.replace(robot, pid=pid, position=position)

    def _numbered(self, agents: list[Agent], places: tuple[Path, ...]) -> list[tuple[Agent, Path]]:
        by_pid: dict[int, tuple[Agent, Path]] = {}
        for agent, path in zip(agents, places, strict=True):
            written = agent.pid + self._first
            if agent.pid in by_pid:
                self._say((*path, "pid"), f"two robots have pid {written}")
            elif agent.pid >= len(agents):
                least, most = self._first, self._first + len(agents) - 1
                hint = f"pids of {len(agents)} robots are {least} to {most}"
                self._say((*path, "pid"), f"pid {written} leaves a gap", hint)
            else:
                by_pid[agent.pid] = (agent, path)
        return [by_pid[pid] for pid in sorted(by_pid)]

    def _robot(
        self, form: Form, agent: Agent, path: Path, talk: Talk, world: World | None
    ) -> RobotPlace:
        name, device, where = self._device(form, agent, path)
        device, own = _addressed(device, agent)
        agent = self._suiting(name, device, agent, path)
        kind = (name, where, agent.motion_automaton)
        vehicle = self._vehicles.get(kind)
        if vehicle is None:
            vehicle = self._driven(form, name, device, agent.motion_automaton, where, world)
            self._vehicles[kind] = vehicle
        position = form.positions.get(agent.pid, agent.position)
        ip = device.ip or "127.0.0.1"
        if device.ip:
            self._check_ip(ip, (*(path if own else where), "ip"))
        port = device.port or talk.port
        if device.ip is None and device.port is None:
            port = talk.port + 1 + agent.pid  # one port per robot on this machine
        place = None if position is None else _point(position)
        if agent.pid in form.positions:
            path = ("positions", agent.pid + self._first)
        elif position is not None:
            path = (*path, "position")
        address = (ip, port)
        return RobotPlace(agent.pid, vehicle, agent.kind, place, address, agent.heading, path)

    def _suiting(self, name: str, device: Device, agent: Agent, path: Path) -> Agent:
        """The agent with a motion automaton that its device has. (P-ROS-PUBLISHED)"""
        automata, automaton = automata_of(device), agent.motion_automaton
        own = (*path, "motion_automaton")
        if automaton is not None and not automata:
            self._check_automaton(automaton, own)
        if automaton is None or not automata or automaton in automata:
            return agent
        hint = f"{name} has {', '.join(automata)}"
        story = f"{name} has no {automaton}: {automata[0]} is taken instead"
        self._warn_once(own, story, hint)
        return msgspec.structs.replace(agent, motion_automaton=automata[0])

    def _check_automaton(self, name: str, path: Path) -> None:
        """Warn of a motion automaton that is none of the published ones: ROS drivers refuse it."""
        if name not in _PUBLISHED_AUTOMATA:
            near = get_close_matches(name, _PUBLISHED_AUTOMATA, n=1)
            known = " and ".join(_PUBLISHED_AUTOMATA)
            hint = f"did you mean {near[0]}?" if near else f"known are {known}"
            story = (
                f"there is no motion automaton {name}: simulated vehicles move as their type does"
            )
            self._warn_once(path, story, hint)

    def _warn_once(self, path: Path, message: str, hint: str) -> None:
        """Warn of what is taken otherwise than it is written; it may stand there for many."""
        told = taken_otherwise(self._document, path, message, hint)
        if all(told.span != one.span for one in self._warnings):
            self._warnings.append(told)

    def _device(self, form: Form, agent: Agent, path: Path) -> tuple[str, Device, Path]:
        """The device that a robot runs on, its name, and its place in the file."""
        if form.device is not None:
            name = form.device.bot_name or agent.on_device or "device"
            if agent.on_device not in (None, name):
                hint = f"the device is called {name}"
                self._say(("robot", "on_device"), f"there is no device {agent.on_device}", hint)
            return name, form.device, ("device",)
        name = agent.on_device or f"robot {agent.pid}"
        if agent.on_device is None:
            return name, Device(), path
        assert isinstance(form.devices, dict)  # as adopted
        if name not in form.devices:
            near = get_close_matches(name, form.devices, n=1)
            known = ", ".join(form.devices) or "none"
            hint = f"did you mean {near[0]}?" if near else f"the devices are: {known}"
            self._say((*path, "on_device"), f"there is no device {name}", hint)
            return name, Device(), path
        return name, form.devices[name], self._places[name]

    def _driven(
        self,
        form: Form,
        name: str,
        device: Device,
        automaton: str | None,
        where: Path,
        world: World | None,
    ) -> Vehicle:
        """Make the vehicle of a device, with its limits and its localiser."""
        stated = where if device.motion_automata else (*where, "motion")
        for i, one in enumerate(automata_of(device)):
            self._check_automaton(one, (*stated, "motion_automata", i))
        safety = self._safety(form, device, where, world)
        localiser = stated_localiser(form, device, where, driven=driver_of(device) is not None)
        for flawed, story, cure in localiser.flaws:
            self._once(flawed, story, cure)
        return msgspec.structs.replace(
            self._vehicle(name, device, automaton, where),
            safety=safety,
            localiser=localiser.name,
            localiser_options=msgspec.json.encode(localiser.options),
        )

    def _vehicle(self, name: str, device: Device, automaton: str | None, path: Path) -> Vehicle:
        """Make the vehicle of a device; fields under ``motion`` count as the device's own."""
        motion = device.motion if device.motion is not None else Motion()
        where = path if device.planner is not None else (*path, "motion")
        named = device.planner or motion.planner
        found = plugged(device, named)
        for field, story, hint in found.flaws:
            self._once((*path, *field), story, hint)
        planner = found.planner or self._planner(named, device.bot_type, where)
        return Vehicle(
            name,
            device.bot_type,
            planner,
            device.speed,
            automata_of(device),
            device.simulation,
            path,
            driver=driver_of(device),
            options=msgspec.json.encode({**topics(name, device, automaton), **device.options}),
            controller=found.controller,
            modules=found.modules,
        )

    def _safety(self, form: Form, device: Device, where: Path, world: World | None) -> SafetyLimits:
        """The limits of a robot on a device."""
        body = VEHICLES[device.bot_type].body
        body = body if device.speed is None else body.cruising(device.speed)
        own = (device.safety, (*where, "safety"))
        stated = stated_safety(body, (form.safety, ("safety",)), own)
        for path, story in safety_flaws(stated, world):
            self._once(path, story, _SAFETY_HINT)
        return stated.limits

    def _planner(self, name: str | None, type_name: str, path: Path) -> PlannerName | None:
        found = None if name is None else planner_named(name, type_name)
        if isinstance(found, tuple):
            self._once((*path, "planner"), *found)
            return None
        return found

    def _once(self, path: Path, message: str, hint: str) -> None:
        """Report a problem of a device once, though each robot on it is checked."""
        found = problem(self._document.place(path), message, hint)
        if found not in self.problems:
            self.problems.append(found)

    def _check_addresses(self, form: Form, robots: tuple[RobotPlace, ...]) -> None:
        taken: dict[tuple[str, int], int] = {}
        for robot in robots:
            other = taken.setdefault(robot.address, robot.pid)
            if other == robot.pid:
                continue
            if form.device is not None:
                hint = "write the robots as `agents:` and `devices:`, each with its ip"
                self._say(("device",), "all robots would have one address", hint)
                return
            ip, port = robot.address
            path: Path = ("devices", robot.vehicle.name)
            self._say(path, f"robots {other} and {robot.pid} both listen on {ip}:{port}")

    def _check_topics(self, robots: tuple[RobotPlace, ...]) -> None:
        """Warn of devices whose topics cannot have their names; two may not share topics."""
        published = {r.vehicle.name: r.vehicle for r in robots if r.vehicle.driver == PUBLISHED}
        taken: dict[str, str] = {}
        warned = set[Path]()
        for name, vehicle in published.items():
            word = topic_word(name)
            other = taken.setdefault(word, name)
            if other != name:
                story = f"{other} and {name} would have the same topics, those of {word}"
                self._say(vehicle.path, story, "names of topics have letters, digits and `_` alone")
            elif word != name and vehicle.path not in warned:
                warned.add(vehicle.path)
                story = f"topics of {name} are those of {word}"
                hint = "names of topics have letters, digits and `_` alone"
                self._warnings.append(taken_otherwise(self._document, vehicle.path, story, hint))

    # --- network --------------------------------------------------------------------------------

    def _talk(self, form: Form) -> Talk:
        network = form.network if form.network is not None else NetworkForm()
        carrier = network.transport or (
            Carrier.BROADCAST if form.udp_bcast_ip is not None else Carrier.MULTICAST
        )
        shared: str | None = None
        if carrier is Carrier.MULTICAST:
            shared = network.group or DEFAULT_GROUP
            ip = self._check_ip(shared, ("network", "group"))
            if ip is not None and not ip.is_multicast:
                hint = "multicast addresses are 224.0.0.0 to 239.255.255.255"
                self._say(("network", "group"), f"{shared} is no multicast address", hint)
        elif carrier is Carrier.BROADCAST:
            shared = form.udp_bcast_ip
            if shared is None:
                hint = "write udp_bcast_ip: 192.168.1.255"
                self._say(("network", "transport"), "it is not said where to broadcast to", hint)
            else:
                self._check_ip(shared, ("udp_bcast_ip",))
        if network.interface is not None:
            self._check_ip(network.interface, ("network", "interface"))
        self._check_key(network)
        return Talk(
            carrier,
            network.port or form.udp_port or DEFAULT_PORT,
            shared,
            network.interface or "0.0.0.0",
            None if network.key is None else network.key.encode(),
            network.key_file,
            network.encrypt,
            network.run or "koord",
            tuple(network.connect),
            tuple(network.listen),
        )

    def _check_key(self, network: NetworkForm) -> None:
        story = None if network.key is None else weakness(network.key.encode())
        if story is not None:
            self._say(("network", "key"), story, HINT)
        if network.key is not None and network.key_file is not None:
            hint = "leave `key` out, or `key_file`"
            self._say(("network", "key_file"), "the key is given twice", hint)

    def _check_ip(self, text: str, path: Path) -> IPv4Address | None:
        try:
            return IPv4Address(text)
        except AddressValueError:
            self._say(path, f"{text!r} is no IPv4 address", "as in 192.168.1.17")
            return None

    # --- world ----------------------------------------------------------------------------------

    def _world(self, form: WorldForm) -> World:
        plain = World()
        low, high = plain.low, plain.high
        if form.bounds is not None:
            low, high = _point(form.bounds.low), _point(form.bounds.high, plain.high[2])
            if not all(a < b for a, b in zip(low, high, strict=True)):
                self._say(("world", "bounds"), "`low` has to be below `high` in x, y and z")
        obstacles = [
            obstacle
            for k, one in enumerate(form.obstacles)
            if (obstacle := self._obstacle(one, ("world", "obstacles", k))) is not None
        ]
        tasks = tuple(_point(task) for task in form.tasks)
        for k, task in enumerate(tasks):
            if form.bounds is not None and not all(
                a <= x <= b for a, x, b in zip(low, task, high, strict=True)
            ):
                self._say(("world", "tasks", k), "this task lies outside of the world")
        return World(low, high, tuple(obstacles), tasks, form.cell or plain.cell_m)

    def _scatter(self, form: WorldForm | None, world: World | None) -> Scatter:
        if form is None or world is None:
            return Scatter()
        if form.start is None:
            return Scatter(form.scattered)
        low, high = _point(form.start.low), _point(form.start.high)
        inside = all(
            a <= x <= y <= b for a, x, y, b in zip(world.low, low, high, world.high, strict=True)
        )
        if not (inside if form.bounds is not None else low <= high):
            self._say(("world", "start"), "`low` and `high` span no part of the world")
        return Scatter(form.scattered, (low, high))

    def _obstacle(self, form: ObstacleForm, path: Path) -> Obstacle | None:
        given = [one for one in (form.box, form.disc, form.polygon) if one is not None]
        if len(given) != 1:
            self._say(path, "an obstacle is one of `box`, `disc` and `polygon`")
        elif form.box is not None:
            low, high = _point(form.box.low), _point(form.box.high, math.inf)
            if all(a < b for a, b in zip(low, high, strict=True)):
                return Box(low, high)
            self._say((*path, "box"), "`low` has to be below `high` in x, y and z")
        elif form.disc is not None:
            x, y = form.disc.centre
            return Disc((x, y), form.disc.radius, form.disc.low_z, _height(form.disc.high_z))
        elif form.polygon is not None:
            corners = tuple((x, y) for x, y in form.polygon.corners)
            return Polygon(corners, form.polygon.low_z, _height(form.polygon.high_z))
        return None


def _addressed(device: Device, agent: Agent) -> tuple[Device, bool]:
    """The device where its agent listens, and whether the agent says so itself."""
    if agent.ip is None and agent.port is None:
        return device, False
    ip, port = agent.ip or device.ip, agent.port or device.port
    return msgspec.structs.replace(device, ip=ip, port=port), agent.ip is not None


def _point(coordinates: Coordinates, z: float = 0.0) -> Point:
    x, y, *rest = coordinates
    return float(x), float(y), float(rest[0]) if rest else z


def _height(height: float | None) -> float:
    return math.inf if height is None else height
