"""Ranges of communication: who hears whom, and who agrees on rounds. [ENV-RANGE]"""

from __future__ import annotations

from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import koord
from koord.api.fitting import FitRequest, Fitted, fit
from koord.api.sim_setup import simulation
from koord.runtime.configuration.checking import load
from koord.sim.groups import GroupedSimulation
from koord.sim.radio import Radio, Reception
from koord.sim.running import Simulation, run
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source

#: Robots count their rounds and those of all, and keep whom they hear; the last one drives away.
PROGRAM = """\
using Motion:
    sensors:
        pos psn
    actuators:
        pos target

using Radio:

allread:
    int[] rounds = 0

local:
    bool[numAgents] heard

init:
    heard = Radio.inRange
    Motion.target = Motion.psn

Count:
    eff:
        rounds[pid] = rounds[pid] + 1
        heard = Radio.inRange
        if pid == numAgents - 1:
            Motion.target = Motion.psn + pos3d(0.5, 0)
"""

#: The same with a module that has a model: then all robots read sensors where their programs are.
MODELLED = f"""\
using Counter:
    sensors:
        int n
    environment:
        n = 7

{PROGRAM}"""

URGENT = PROGRAM.replace("Count:", "urgent Count:\n    pre: rounds[pid] < 9")


def fitted(radio: str, program: str = PROGRAM, robots: int = 4) -> Fitted:
    """Robots in a row, 2 m apart."""
    places = ", ".join(f"{pid}: [{2 * pid}, 0, 1]" for pid in range(robots))
    lines = f"num_robots: {robots}\npositions: {{{places}}}\nradio: {radio}\ndelta: 0.5\n"
    lines += "device: {bot_type: IDEAL, planner: STRAIGHT}\n"
    lines += "world: {bounds: {low: [-4, -4, 0], high: [30, 9, 3]}}\n"
    source = Source("row.krd", program)
    return fit(FitRequest(source, load(Source("row.yaml", lines)), (), {}))


def after(made: Fitted, rounds: int, *, kernels: bool = True) -> Simulation:
    simulated = simulation(made, Simulation, kernels=kernels)
    simulated.begin()
    list(run(simulated, rounds * 0.5))
    assert simulated.fault is None
    return simulated


def heard(simulated: Simulation) -> list[str]:
    """Whom each robot hears, by its own account: as many letters as there are robots."""
    told = [vars(robot)["heard"] for robot in simulated.engine.robots]
    return ["".join("x" if one else "." for one in row) for row in told]


# --- who hears whom -------------------------------------------------------------------------------


def test_robots_hear_those_in_range_and_not_themselves() -> None:
    places = np.array([(0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (3.0, 4.0, 0.0), (0.0, 0.0, 3.5)])
    reception = Reception(Radio(3.5), places)
    row = reception.heard(0)
    assert row == (False, True, False, True)  # the last at the range itself
    assert reception.heard(2) == (False, False, False, False)
    reception.measure(places + 1.0)
    assert reception.heard(0) is row
    reception.measure(np.zeros((4, 3)))
    assert reception.heard(0) == (False, True, True, True)


def test_who_is_where_when_measured_counts() -> None:
    places = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    reception = Reception(Radio(2.0), places)
    places[1, 0] = 9.0  # the arrays of a fleet go on
    assert reception.heard(0) == (False, True)


def test_programs_sense_who_is_in_range() -> None:
    assert heard(after(fitted("{range: 2.5}"), 0)) == [".x..", "x.x.", ".x.x", "..x."]
    # After four rounds more the last one has gone out of sight of the one before.
    assert heard(after(fitted("{range: 2.5}"), 5)) == [".x..", "x.x.", ".x..", "...."]


def test_without_a_range_everybody_hears_everybody() -> None:
    assert heard(after(fitted("{}"), 3)) == [".xxx", "x.xx", "xx.x", "xxx."]


def test_who_is_in_range_is_by_true_positions() -> None:
    """However badly robots know where they are themselves."""
    made = fitted("{range: 2.5}")
    lines = made.configuration.document.source.text.replace(
        "planner: STRAIGHT", "planner: STRAIGHT, simulation: {noise: {position: 5.0}}"
    )
    source = Source("row.krd", PROGRAM.replace("+ pos3d(0.5, 0)", ""))
    noisy = fit(FitRequest(source, load(Source("row.yaml", lines)), (), {}))
    simulated = simulation(noisy, Simulation)
    simulated.begin()
    assert heard(simulated) == [".x..", "x.x.", ".x.x", "..x."]


# --- who agrees on rounds -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("row", "members"),
    [
        ((0, 1, 2, 3, 4), (0, 1, 2, 3, 4)),  # each hears the next
        ((0, 1, 2, 9, 10), (0, 1, 2)),
        ((9, 10, 0, 1, 2), (2, 3, 4)),
        ((0, 1, 5, 9, 10), ()),
        ((0, 1, 9, 10), ()),  # half are no majority
        ((0, 9, 1, 10, 2), (0, 2, 4)),
        ((0,), (0,)),
    ],
)
def test_those_agree_who_are_connected_with_more_than_half(
    row: tuple[int, ...], members: tuple[int, ...]
) -> None:
    places = np.array([(x, 0.0, 0.0) for x in row], np.float64)
    found = Reception(Radio(1.0), places).members
    assert tuple(np.flatnonzero(found)) == members


@pytest.mark.parametrize("kernels", [True, False])
def test_who_is_out_of_reach_skips(kernels: bool) -> None:
    """The last robot leaves after a few rounds and skips from then on. [SKIP] [T-SKIP]"""
    connected = after(fitted("{range: 2.5, agreement: connected}"), 20, kernels=kernels)
    counts = connected.engine.store.values["rounds"]
    assert counts[:3] == (20, 20, 20)
    assert 0 < counts[3] < 10
    everywhere = after(fitted("{range: 2.5}"), 20, kernels=kernels)
    assert everywhere.engine.store.values["rounds"] == (20, 20, 20, 20)


def test_machine_code_and_processes_change_no_run_by_radio() -> None:
    made = fitted("{range: 2.5, agreement: connected}")
    alone = after(made, 20).digest
    assert after(made, 20, kernels=False).digest == alone
    for program in (PROGRAM, MODELLED):
        made = fitted("{range: 2.5, agreement: connected}", program)
        with closing(simulation(made, partial(GroupedSimulation, processes=2))) as grouped:
            grouped.begin()
            list(run(grouped, 10.0))
            assert grouped.digest == alone
            assert heard(grouped)[2] == ".x.."


def test_a_run_by_radio_is_one_of_the_semantics(tmp_path: Path) -> None:
    made = fitted("{range: 2.5, agreement: connected}")
    kept = tmp_path / "run.json"
    source, configuration = Source("row.krd", PROGRAM), made.configuration
    koord.simulate(source, configuration, rounds=12, trace=kept)
    assert koord.replay(kept, compiled=True).legal


def test_rounds_that_wait_for_robots_are_not_agreed_on_by_radio() -> None:
    made = fitted("{range: 2.5, agreement: connected}", URGENT)
    with pytest.raises(KoordError) as refused:
        simulation(made, Simulation)
    (diagnostic,) = refused.value.diagnostics
    assert (diagnostic.code, diagnostic.span.line) == ("K931", 3)
    after(fitted("{range: 2.5}", URGENT), 5)


def test_an_agreement_that_there_is_not_is_told() -> None:
    with pytest.raises(KoordError) as refused:
        fitted("{agreement: nobody}")
    (diagnostic,) = refused.value.diagnostics
    assert diagnostic.hint == "it is one of everywhere, connected"
