"""Modules: ports, environments, contracts, those of the library."""

from __future__ import annotations

from fractions import Fraction

import pytest

from koord.syntax import core
from koord.syntax.types import FLOAT, POS, ListType
from tests.syntax.elaborating import codes, errors, only, program


def ports(made: core.Program, agent: int = 0) -> list[tuple[str, str, str]]:
    return [
        (port.module, port.direction.value, port.declaration.variable.name)
        for port in made.agents[agent].ports
    ]


def test_ports_of_the_library_are_there_without_a_body() -> None:
    made = program("""
        using Motion
        Go:
          pre: Motion.reached
          eff: target = psn
    """)
    assert ports(made) == [
        ("Motion", "sensor", "psn"),
        ("Motion", "sensor", "reached"),
        ("Motion", "actuator", "target"),
    ]
    (module,) = made.agents[0].modules
    assert module.ports == (0, 1, 2)
    assert module.environment is None


def test_a_variable_that_is_called_like_a_port_asks_for_no_port() -> None:
    text = """
    using Motion
    allread:
      pos[][] route
    Go:
      eff: route[pid] = [Motion.psn]
    """
    assert [p.declaration.variable.name for p in program(text).agents[0].ports] == ["psn"]
    both = program(f"{text}\n    Tell:\n      eff: Motion.route = route[pid]\n")
    assert [p.declaration.variable.name for p in both.agents[0].ports] == ["psn", "route"]


def test_a_field_that_is_called_like_a_port_asks_for_no_port() -> None:
    """Behind a dot stands a port only where a module stands before it."""
    text = """
        using Motion
        allwrite:
          Task[2] list
        local:
          pos p
        Go:
          eff: p = list[0].target
               %s
    """
    assert ports(program(text % "p = Motion.psn")) == [("Motion", "sensor", "psn")]
    made = ports(program(text % "Motion.target = p"))
    assert made == [("Motion", "actuator", "target")]


def test_a_programs_list_adds_to_the_librarys_and_overrides_its_types() -> None:
    made = program("""
        using Motion:
          sensors:
            float battery
          actuators:
            pos path
        Go:
          pre: Motion.battery > 0 and Motion.done
          eff: Motion.path = Motion.position
    """)
    assert sorted(ports(made)) == [
        ("Motion", "actuator", "path"),
        ("Motion", "sensor", "battery"),
        ("Motion", "sensor", "psn"),
        ("Motion", "sensor", "reached"),
    ]
    types = {p.declaration.variable.name: p.declaration.variable.type for p in made.agents[0].ports}
    assert types["path"] == POS


def test_two_names_of_a_port_denote_one() -> None:
    made = program("""
        using Motion:
          sensors:
            pos position
        local:
          float d = 0
        Go:
          eff: d = Motion.psn.x + position.x
    """)
    assert ports(made) == [("Motion", "sensor", "psn")]


def test_ports_without_their_module() -> None:
    found = only("Go:\n  eff: Motion.target = pos(0, 0, 0)\n")
    assert (found.code, found.hint) == ("K207", "begin the program with `using Motion`")
    found = only("local:\n  float t = 0\nGo:\n  eff: t = HVAC.temp\n")
    assert found.code == "K201"
    assert found.hint is not None
    assert "using HVAC" in found.hint


def test_a_bare_port_must_be_one_modules() -> None:
    two = """
        using Left:
          sensors:
            float range
        using Right:
          sensors:
            float range
          environment:
            range = range + 1
        local:
          float near = 0
        Look:
          eff: near = %s
    """
    assert errors(two % "range") == ["K210"]
    assert errors(two % "Left.range + Right.range") == []


def test_sections_of_a_module_are_merged() -> None:
    made = program("""
        using Heater:
          sensors:
            float temp = 70
        using Heater:
          actuators:
            int switch
          contract Warm:
            requires: temp >= 60
            ensures: temp' >= 60 and Heater.temp' < 90
        Heat:
          eff: Heater.switch = 1
    """)
    assert len(made.agents[0].modules) == 1
    assert made.agents[0].ports[0].declaration.initial == core.Const(Fraction(70), FLOAT)
    (contract,) = made.agents[0].modules[0].contracts
    assert (contract.name, len(contract.requires), len(contract.ensures)) == ("Warm", 1, 1)
    (ensures,) = contract.ensures
    assert isinstance(ensures, core.Binary)
    assert isinstance(ensures.left, core.Binary)
    read = ensures.left.right
    assert isinstance(read, core.Read)
    assert (read.place.primed, read.place.robot) == (True, None)


def test_starts_of_ports() -> None:
    made = program("""
        using Heater:
          sensors:
            float temp
          actuators:
            int switch
            int level = 2
        Heat:
          eff: switch = 1
               level = 3
    """)
    starts = [port.declaration.initial for port in made.agents[0].ports]
    assert starts[:2] == [core.Start.ARBITRARY, core.Start.UNSET]
    assert isinstance(starts[2], core.Const)


def test_the_clock_has_an_environment() -> None:
    made = program("""
        using Clock
        local:
          float since = 0
        Note:
          eff: since = Clock.now
    """)
    (module,) = made.agents[0].modules
    assert module.environment is not None
    (assign,) = module.environment
    assert isinstance(assign, core.Assign)
    assert assign.place.variable.name == "now"
    drifting = program("""
        using Clock:
          environment:
            now = now + delta * (1 + choose(-0.1, 0.1))
        local:
          float since = 0
        Note:
          eff: since = now
    """)
    own = drifting.agents[0].modules[0].environment
    assert own is not None
    assert own != module.environment


def test_environments_choose_and_branch() -> None:
    made = program("""
        using Heater:
          sensors:
            float temp = 70
            int[] log = []
          actuators:
            int switch
          environment:
            if switch > 0:
              temp = temp + delta * switch + choose(-0.5, 1)
            else:
              temp = temp - delta
            for i = 0, 2: log.append(i)
        Heat:
          eff: switch = 1
    """)
    (module,) = made.agents[0].modules
    assert module.environment is not None
    assert module.environment_bound == 1
    assert made.agents[0].ports[1].declaration.variable.type == ListType(
        core.Const(0, made.agents[0].ports[2].declaration.variable.type).type
    )


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("temp = power", "K239"),
        ("power = 3", "K239"),
        ("Motion.psn = pos(0, 0, 0)", "K239"),
        ("temp = temp'", "K303"),
        ("stop", "K225"),
        ("atomic: temp = 1", "K225"),
        ('stdout << "hot"', "K225"),
        ("temp = true", "K204"),
        ("return", "K221"),
        ("int temp = true", "K204"),
    ],
)
def test_environments_keep_to_their_ports(line: str, code: str) -> None:
    text = f"""
local:
  float power = 1
using Motion
using Heater:
  sensors:
    float temp
  environment:
    {line}
Go:
  eff: Motion.target = psn
       power = 2
"""
    assert errors(text) == [code]


def test_environments_may_declare_variables_of_their_own() -> None:
    """Gone when the block ends; ports are still read as they were before the turn. [ENV-MODEL]"""
    made = program("""
        using Heater:
          sensors:
            float temp = 60
          environment:
            float gain = 0
            for i = 0, 3:
              gain = gain + i
            temp = temp + gain
    """)
    (module,) = made.agents[0].modules
    assert module.environment is not None
    assert module.environment_bound == 2
    first = module.environment[0]
    assert isinstance(first, core.Assign)
    assert first.place.variable.home is core.Home.BOUND


def test_streams_are_ports_without_a_value() -> None:
    made = program("""
        using Log:
          sensors:
            int stdin
          actuators:
            stream errors
        Go:
          eff: Log.errors << Log.stdin
               Log.stdout << "hi"
    """)
    assert ports(made) == [("Log", "sensor", "stdin")]
    streams = [s.stream for s in made.agents[0].events[0].effect if isinstance(s, core.Output)]
    assert streams == ["Log.errors", "stdout"]
    assert errors("using Log\nGo:\n  eff: Log.stdout = 3\n") == ["K238"]
    assert errors("using Log\nlocal:\n  int n = 0\nGo:\n  eff: n = stdout\n") == ["K238"]
    assert errors("using Log\nGo:\n  eff: stdout << stdout\n") == ["K238"]


def test_contracts_that_contradict_themselves() -> None:
    text = """
        using Heater:
          sensors:
            float temp
          contract Never:
            requires: 1 > 2
            ensures: false and temp' > 3
    """
    assert codes(text) == ["K404", "K404"]


def test_contracts_speak_of_ports_only() -> None:
    above = """
local:
  float limit = 1
using Heater:
  sensors:
    float temp
  contract Warm:
    %s
Go:
  eff: limit = 2
"""
    assert errors(above % "ensures: temp' < limit") == ["K307"]
    assert errors(above % "requires: temp' < 2") == ["K303"]
    assert errors(above % "requires: temp") == ["K204"]
    assert errors(above % "ensures: forall i: i != pid implies temp@i' < temp' + pid") == []
    assert errors(above % "ensures: ran(Go)") == ["K304"]
