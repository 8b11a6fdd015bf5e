"""Forms of the published middleware, as the form of several robots: ``agents`` and ``devices``.

What is taken otherwise than it is written is warned of (K949). (specs/decisions/0107)
"""

from __future__ import annotations

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.configuration.forms import Agent, Device, Form
from koord.runtime.configuration.reading import Document, Path, problem
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity


class Adopted(Struct, frozen=True):
    """A form whose robots stand in ``agents`` and ``devices``, or in the form of one kind of robot.

    ``agents`` are the places of its agents in the file, in their order, ``devices`` those of its
    devices by name. The robot with the lowest pid in the file, ``first``, is robot 0.
    """

    form: Form
    agents: tuple[Path, ...] = ()
    devices: dict[str, Path] = {}
    first: int = 0
    warnings: tuple[Diagnostic, ...] = ()


def taken_otherwise(document: Document, path: Path, message: str, hint: str) -> Diagnostic:
    """Warn of what is taken otherwise than it is written."""
    return Diagnostic("K949", Severity.WARNING, document.place(path), message, hint)


def adopted(form: Form, document: Document) -> Adopted:
    """The form with robots as they are given today. Raises KoordError.

    A file for one agent, as the published launcher makes them, tells of the others no more than how
    many they are: they are taken to be like it.
    """
    if form.agent is not None:
        made = _of_one(form, form.agent, document)
    elif form.num_agents is not None:
        raise _refused(document, ("num_agents",), "there is no `agent` in this file", _WHOLE)
    else:
        made = _of_several(form, document)
    return _from_zero(made, document)


_WHOLE = "`agent`, `device` and `num_agents` are one form, `agents` and `devices` another"


def _refused(document: Document, path: Path, message: str, hint: str) -> KoordError:
    return KoordError((problem(document.name_place(path), message, hint),))


def automata_of(device: Device) -> tuple[str, ...]:
    """The motion automata of a device; there may be one, without brackets."""
    motion = None if device.motion is None else device.motion.motion_automata
    found = device.motion_automata or motion or ()
    return (found,) if isinstance(found, str) else tuple(found)


# --- a file for one agent -------------------------------------------------------------------------


def _of_one(form: Form, agent: Agent, document: Document) -> Adopted:
    """Copies of the one agent that is described, each on a device of its own."""
    for other in ("agents", "devices", "bots", "robot", "num_robots"):
        if other in document.value:
            raise _refused(document, (other,), "the robots are given in two forms", _WHOLE)
    count = form.num_agents
    if count is None and agent.plist:  # before there was `num_agents`: ports of the others
        count = 1 + len(agent.plist)
    if count is None:
        story = "it is not said how many robots there are"
        raise _refused(document, ("agent",), story, "write num_agents: 3")
    if agent.pid > count:
        story = f"pid {agent.pid} is not one of {count} robots"
        raise _refused(
            document, ("agent", "pid"), story, f"pids are 0 to {count - 1}, or 1 to {count}"
        )
    device = form.device or Device()
    name = device.bot_name or agent.on_device or f"robot{agent.pid}"
    if agent.on_device not in (None, name):
        story = f"there is no device {agent.on_device}"
        raise _refused(document, ("agent", "on_device"), story, f"the device is called {name}")
    like = replace(device, bot_name=None, ip=None, port=None)
    first = 1 if agent.pid == count else 0
    agents, devices = list[Agent](), dict[str, Device]()
    for pid in range(first, first + count):
        own = pid == agent.pid
        called = name if own else f"{name}-{pid}"
        devices[called] = device if own else like
        agents.append(
            replace(agent, on_device=called)
            if own
            else replace(agent, pid=pid, on_device=called, position=None, ip=None, port=None)
        )
    warnings = []
    if count > 1:
        story = f"this file tells of robot {agent.pid} alone: {count - 1} more are taken like it"
        hint = "where they are, and on which devices, a file with `agents` and `devices` says"
        warnings.append(taken_otherwise(document, ("agent",), story, hint))
    whole = replace(form, agent=None, num_agents=None, device=None, agents=agents, devices=devices)
    return Adopted(
        whole,
        (("agent",),) * count,
        dict.fromkeys(devices, ("device",)),
        warnings=tuple(warnings),
    )


# --- a file for all -------------------------------------------------------------------------------


def _of_several(form: Form, document: Document) -> Adopted:
    """Devices by their names, also where they are a list, or `bots`."""
    field = "bots" if form.bots else "devices"
    if form.bots and form.devices:
        raise _refused(document, ("bots",), "devices are given twice", "leave `bots` out")
    given = form.bots or form.devices
    agents = list(form.agents)
    if isinstance(given, dict):
        places: dict[str, Path] = {name: (field, name) for name in given}
        devices, warnings = given, list[Diagnostic]()
    else:
        devices, places = _named(given, field, document)
        warnings = _dealt(agents, devices, places, document)
    return Adopted(
        replace(form, agents=agents, devices=devices, bots={}),
        tuple(("agents", k) for k in range(len(agents))),
        places,
        warnings=tuple(warnings),
    )


def _named(
    given: list[Device], field: str, document: Document
) -> tuple[dict[str, Device], dict[str, Path]]:
    """A list of devices by their names."""
    devices, places = dict[str, Device](), dict[str, Path]()
    for k, device in enumerate(given):
        path: Path = (field, k)
        name = device.bot_name or f"device{k}"
        if name in devices:
            story = f"two devices are called {name}"
            raise _refused(document, (*path, "bot_name"), story, "each has a name of its own")
        devices[name], places[name] = device, path
    return devices, places


def _dealt(
    agents: list[Agent], devices: dict[str, Device], places: dict[str, Path], document: Document
) -> list[Diagnostic]:
    """Put agents that name no device on those of a list, in the order of both; change them all."""
    warnings = []
    listed = list(devices)
    named = {agent.on_device for agent in agents}
    free = [name for name in listed if name not in named]
    for k, agent in enumerate(agents):
        if agent.on_device is not None or not listed:
            continue
        if free:
            name = free.pop(0)
        else:
            like = listed[-1]
            name = f"{like}-{agent.pid}"
            devices[name] = replace(devices[like], bot_name=None, ip=None, port=None)
            places[name] = places[like]
            story = f"there is no device left for robot {agent.pid}: one like {like} is taken"
            hint = "say with `on_device` which device each agent runs on"
            warnings.append(taken_otherwise(document, ("agents", k), story, hint))
        agents[k] = replace(agent, on_device=name)
    return warnings


# --- numbers --------------------------------------------------------------------------------------


def _from_zero(made: Adopted, document: Document) -> Adopted:
    """Number robots from 0 where the lowest pid is another one."""
    form = made.form
    first = min((agent.pid for agent in form.agents), default=0)
    if first == 0:
        return made
    leader = form.leader_pid - first if "leader_pid" in document.value else 0
    story = f"pids begin at {first} here, and robots are numbered from 0: pid {first} is robot 0"
    hint = "programs, `koord deploy --pid` and reports count from 0"
    path = (*made.agents[0], "pid")
    return Adopted(
        replace(
            form,
            agents=[replace(agent, pid=agent.pid - first) for agent in form.agents],
            leader_pid=leader,
            positions={pid - first: place for pid, place in form.positions.items()},
        ),
        made.agents,
        made.devices,
        first,
        (*made.warnings, taken_otherwise(document, path, story, hint)),
    )
