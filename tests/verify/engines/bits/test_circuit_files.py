"""What is written for other tools means what the circuit means."""

from __future__ import annotations

import shutil
import subprocess
from collections import Counter
from pathlib import Path
from random import Random

import pytest
import z3

from koord.cli import main as frame
from koord.cli.exits import Exit
from koord.refinement.generating.programs import system
from koord.syntax.system import dealt
from koord.verify.claims import claims_of
from koord.verify.engines.bits.circuit import Circuit, circuit_of
from koord.verify.engines.bits.circuit_files import (
    Format,
    TransitionSystem,
    exported,
    machine_of,
)
from koord.verify.engines.bits.clauses import QUICK, Clauses
from koord.verify.engines.bits.graph import FALSE, TRUE, Graph
from koord.verify.engines.bits.unrolling import Copy
from tests.generators.profiles import FINITE
from tests.loading import program_of
from tests.sampling import first
from tests.verify.asking import bounded
from tests.verify.engines.bits.aiger import read, read_binary
from tests.verify.engines.bits.asking import finite_circuit


def abc_of() -> str | None:
    return shutil.which("berkeley-abc") or shutil.which("abc")


SEEDS = range(9_000, 9_040)
CLAIMING = Path("benchmarks/programs/claiming.krd")


def in_range(of: Circuit, random: Random) -> dict[int, bool]:
    """Numbers of a state that are in their ranges, as all are that a round leads to."""
    given: dict[int, bool] = {}
    for number in of.ranges:
        value = random.randint(number.low, number.high)
        given |= {x >> 1: bool((value >> k) & 1) for k, x in enumerate(number.literals) if x > 1}
    return given


def test_aiger_steps_as_the_circuit_does() -> None:
    count = 0
    for seed in SEEDS:
        of = finite_circuit(seed)
        if of is None:
            continue
        text = exported(of, Format.AIGER, 0, "of a test").decode()
        written, machine = read(text), machine_of(of)
        assert len(written.latches) == len(machine.latches)
        assert {v for k, v in written.names.items() if k[0] == "b"} == {c.name for c in of.bad}
        random = Random(seed)
        state = [bool(first) for _, _, first in written.latches]
        assert state == [latch.init == TRUE for latch in machine.latches]
        for _ in range(20):
            inputs = [random.random() < 0.5 for _ in machine.inputs]
            given = {x >> 1: b for x, b in zip(machine.inputs, inputs, strict=True)}
            given |= {x.literal >> 1: b for x, b in zip(machine.latches, state, strict=True)}
            after = machine.graph.values([x.next for x in machine.latches], given)
            bad = machine.graph.values([x for _, x in machine.bad], given)
            assert written.step(state, inputs) == (after, bad), seed
            # Legal steps are rare among random ones: go on from any state as well.
            state = after if random.random() < 0.5 else [random.random() < 0.5 for _ in after]
            count += 1
    assert count >= 400


def test_what_init_breaks_is_bad_before_it_is_over_and_never_again() -> None:
    """Whatever the inputs of INIT are later on."""
    early = late = 0
    for seed in SEEDS:
        of = finite_circuit(seed)
        if of is None:
            continue
        g, machine, random = of.d.graph, machine_of(of, between=False), Random(seed)
        begun, valid, *_ = (latch.literal for latch in machine.latches)
        phases = [(of.bad_start.get(c, FALSE), [x for _, x in p]) for c, p in of.bad.items()]
        lost = g.both(of.lost, of.steps)
        latches = (*machine.latches, *of.latches)
        free = [x >> 1 for x in (*machine.inputs, *(latch.literal for latch in latches))]
        for _ in range(40):
            given = {node: random.random() < 0.5 for node in free} | in_range(of, random)
            given[valid >> 1] = given[begun >> 1]
            found = g.values([x for _, x in machine.bad], given)
            for is_bad, (at_start, inside) in zip(found, phases, strict=True):
                first, *breaks = g.values([at_start, lost, *inside], given)
                over = any(breaks)
                if not given[begun >> 1]:
                    assert is_bad == first, seed
                elif over or is_bad:
                    # What nobody may choose is not chosen: then the mistake is one of other inputs.
                    assert is_bad, seed
                    assert can(of, given, g.any_of([lost, *inside])), seed
                early += first and not given[begun >> 1]
                late += first and given[begun >> 1] and not over
    assert min(early, late) >= 5


def test_a_run_is_one_of_the_rules_no_more_after_an_illegal_step() -> None:
    """What is asked goes on, so that latches have values, but nothing there breaks a claim."""
    legal = illegal = 0
    for seed in SEEDS[:10]:
        of = finite_circuit(seed)
        if of is None:
            continue
        g, machine, random = of.d.graph, machine_of(of, between=False), Random(seed)
        begun, valid, *_ = machine.latches
        free = [x >> 1 for x in (*machine.inputs, *(latch.literal for latch in of.latches))]
        for _ in range(40):
            given = {node: random.random() < 0.5 for node in free} | in_range(of, random)
            given |= {begun.literal >> 1: True, valid.literal >> 1: random.random() < 0.5}
            was = given[valid.literal >> 1]
            still, steps, *bad = g.values(
                [valid.next, of.steps, *(x for _, x in machine.bad)], given
            )
            assert still or not (was and steps), seed
            assert not still or (was and can(of, given, of.steps)), seed
            assert was or not any(bad), seed
            legal += still
            illegal += steps and not still
    assert min(legal, illegal) >= 5


def first_bad(machine: TransitionSystem, most: int) -> list[int | None]:
    """The step from 0 on in which each bad literal can hold first; None if in none up to most."""
    to = Graph()
    clauses = Clauses(to, QUICK)
    found: list[int | None] = [None for _ in machine.bad]
    state = {latch.literal >> 1: latch.init for latch in machine.latches}
    for number in range(most + 1):
        step = Copy(machine.graph, to, f"#{number}", dict(state))
        for k, (_, literal) in enumerate(machine.bad):
            if found[k] is None and clauses.solve([clauses.of(step.of(literal))]):
                found[k] = number
        state = {latch.literal >> 1: step.of(latch.next) for latch in machine.latches}
    clauses.close()
    return found


#: So many rounds are looked at for what breaks.
ROUNDS = 3


def test_between_rounds_the_same_claims_break_as_in_rounds() -> None:
    """[T-ROUND-ENDS]: a state is bad one step after the round; without INIT all is a step sooner.

    So a claim that breaks in round r is bad at the latest in step r + 1, and at the earliest in
    r - 1, which is r without a step for INIT.
    """
    kinds: Counter[str] = Counter()
    for seed in range(9_000, 9_060):
        of = finite_circuit(seed)
        if of is None:
            continue
        rounds = first_bad(machine_of(of, between=False), ROUNDS + 2)
        made = machine_of(of)
        between = first_bad(made, ROUNDS + 2)
        for old, new in zip(rounds, between, strict=True):
            if old is not None and old <= ROUNDS:
                assert new is not None, seed
                assert old - 1 <= new <= old + 1, seed
                kinds["sooner" if new < old else "later" if new > old else "alike"] += 1
            elif new is not None and new <= ROUNDS:
                assert old is not None, seed
            kinds["none"] += old is None
        has_init = any(latch.name == "begun" for latch in made.latches)
        kinds["with INIT" if has_init else "without"] += 1
    assert min(kinds[k] for k in ("alike", "none", "with INIT", "without")) >= 5, kinds
    assert min(kinds[k] for k in ("sooner", "later")) >= 1, kinds


ONE_START = """
allwrite:
  bool here = true
  bool there = false
Go:
  pre: here
  eff:
    atomic:
      here = false
      there = true
Return:
  pre: there
  eff:
    atomic:
      here = true
      there = false
invariant One: here != there
invariant Stays: here
"""


@pytest.mark.skipif(abc_of() is None, reason="abc is not installed (Debian: berkeley-abc)")
def test_latches_start_as_init_leaves_them_for_others_too(tmp_path: Path) -> None:
    """Were it nowhere at first, as false latches say, abc would find that."""
    program, path = tmp_path / "one.krd", tmp_path / "one.aig"
    program.write_text(ONE_START, encoding="utf-8")
    words = ["verify", str(program), "--robots", "2", "--export", "aiger", "-o", str(path)]
    for claim, said in (("One", "Property proved"), ("Stays", "was asserted in frame 1")):
        assert frame.main([*words, "--property", claim]) == Exit.OK
        written = read_binary(path.read_bytes())
        assert any(first for _, _, first in written.latches)
        assert not {"begun", "valid"} & set(written.names.values())
        abc = abc_of()
        assert abc is not None
        command = [abc, "-c", f"read_aiger {path}; pdr"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=True)
        assert said in done.stdout


def test_latches_are_those_that_count_and_robots_own_come_first() -> None:
    """Nobody asks which event a robot ran last, and what is asked hangs on all that is left."""
    claiming = dealt(program_of(CLAIMING.read_text("utf-8")), 2)
    of = circuit_of(claiming, claims_of(claiming))
    machine = machine_of(of)
    names = [latch.name for latch in machine.latches]
    assert len(names) < len(of.latches)
    assert names == sorted(names, key=lambda name: "owner" in name)
    assert {name.partition("@")[0].partition(".")[0] for name in names} == {
        "mine",
        "onTask",
        "owner",
    }
    read = machine.graph.cone([*(x for _, x in machine.bad), *(x.next for x in machine.latches)])
    assert {latch.literal >> 1 for latch in machine.latches} <= set(read)


def can(of: Circuit, given: dict[int, bool], goal: int) -> bool:
    """Return whether a literal can hold in a state, whatever the inputs are."""
    clauses = Clauses(of.d.graph, QUICK)
    state = [clauses.of(x.literal) * (1 if given[x.literal >> 1] else -1) for x in of.latches]
    found = clauses.solve([clauses.of(goal), *state])
    clauses.close()
    return found


@pytest.mark.parametrize("rounds", first(1, [2, 0]))
def test_smt_lib_asks_whether_a_claim_breaks(rounds: int) -> None:
    count: Counter[str] = Counter()
    for seed in range(9_000, 9_025):
        of = finite_circuit(seed)
        if of is None:
            continue
        solver = z3.Solver()
        solver.from_string(exported(of, Format.SMT2, rounds, "of a test").decode())
        answer = solver.check()
        breaks = bounded(system(Random(seed), FINITE), rounds=rounds).rounds
        assert (answer == z3.sat) == bool(breaks), seed
        count[str(answer)] += 1
    assert min(count["sat"], count["unsat"]) >= 5, count


def test_vmt_is_well_formed_and_says_the_same() -> None:
    for seed in SEEDS[:10]:
        of = finite_circuit(seed)
        if of is None:
            continue
        text = exported(of, Format.VMT, 0, "of a test").decode()
        # The solver reads every definition; properties and steps are marked once each.
        z3.Solver().from_string(text)
        assert text.count(":init true") == text.count(":trans true") == 1
        assert text.count(":invar-property") == len(of.bad)
        assert text.count(":next") == len(machine_of(of).latches)


def test_the_command_writes_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "task.aag"
    words = ["verify", "specs/examples/task.krd", "--robots", "2", "--set", "tasks=2"]
    words += ["--property", "Exclusive", "--export", "aiger", "-o", str(path)]
    assert frame.main(words) == Exit.OK
    written = read(path.read_text())
    assert len(written.bad) == 1
    assert written.names["b0"] == "Exclusive"
    assert "assignedTo" in capsys.readouterr().err  # of which nothing is assumed


def test_binary_aiger_says_the_same() -> None:
    for seed in SEEDS[:20]:
        # A graph grows with each question, so each form has a circuit of its own.
        one, two = finite_circuit(seed), finite_circuit(seed)
        if one is None or two is None:
            continue
        text = exported(one, Format.AIGER, 0, "of a test").decode()
        binary = exported(two, Format.AIG, 0, "of a test")
        assert read_binary(binary) == read(text), seed
        assert len(binary) < len(text) or text.startswith("aag 0 "), seed


def test_the_name_of_the_file_makes_it_binary(tmp_path: Path) -> None:
    path = tmp_path / "sum.aig"
    words = ["verify", "specs/examples/sum_of_ids.krd", "--robots", "2", "--export", "aiger"]
    assert frame.main([*words, "-o", str(path)]) == Exit.OK
    assert read_binary(path.read_bytes()).names["b0"] == "PartialSum"


@pytest.mark.skipif(abc_of() is None, reason="abc is not installed (Debian: berkeley-abc)")
def test_abc_reads_it(tmp_path: Path) -> None:
    path = tmp_path / "sum.aig"
    words = ["verify", "specs/examples/sum_of_ids.krd", "--robots", "2", "--export", "aiger"]
    assert frame.main([*words, "--property", "Total", "-o", str(path)]) == Exit.OK
    sizes = read_binary(path.read_bytes())
    abc = abc_of()
    assert abc is not None
    done = subprocess.run(
        [abc, "-c", f"read_aiger {path}; print_stats; pdr"],
        capture_output=True,
        text=True,
        timeout=100,
        check=True,
    )
    assert f"i/o ={len(sizes.inputs):5d}/" in done.stdout
    assert "Property proved" in done.stdout


def test_several_programs_are_too_many_to_export() -> None:
    words = ["verify", "specs/examples/task.krd", "specs/examples/sum_of_ids.krd"]
    assert frame.main([*words, "--export", "vmt"]) == Exit.BAD_INPUT
