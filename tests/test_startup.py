"""Starting is quick because little is loaded: what weighs stays out until a command needs it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from tempfile import NamedTemporaryFile

import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "specs" / "examples"

#: Libraries and floors that neither ``import koord`` nor ``koord --help`` may load.
HEAVY = (
    "z3",
    "lark",
    "numpy",
    "rich",
    "rich_argparse",
    "msgspec",
    "yaml",
    "ompl",
    "pymunk",
    "osqp",
    "shapely",
    "scipy",
    "llvmlite",
    "hypothesis",
    "koord.syntax",
    "koord.semantics",
    "koord.verify",
    "koord.runtime",
    "koord.sim",
)


#: What runs a command as the console script does; it may leave or go on.
COMMAND = (
    "import koord.cli.main\n"
    "sys.argv = ['koord', *{arguments}]\n"
    "try: koord.cli.main.entry()\n"
    "except SystemExit as ending: assert ending.code == 0, ending.code"
)


def modules_after(statement: str, *, alone: bool = False) -> set[str]:
    """The modules that a fresh interpreter and its processes have loaded after a statement.

    Or those of the interpreter ``alone``, whatever processes load that it forks.
    """
    program = (
        "import os, sys\n"
        "first = os.getpid()\n"
        "def tell():\n"
        f"    if {alone} and os.getpid() != first: return\n"
        "    with open(os.environ['LOADED'], 'a') as file:\n"
        "        file.write('\\n'.join(sys.modules) + '\\n')\n"
        "kill = os.kill\n"
        "os.kill = lambda *killed: (tell(), kill(*killed))\n"  # processes leave by it
        "leave = os._exit\n"
        "os._exit = lambda code: (tell(), leave(code))\n"  # and commands
        f"{statement}\n"
        "tell()\n"
    )
    with NamedTemporaryFile() as loaded:
        done = subprocess.run(
            [sys.executable, "-c", program],
            capture_output=True,
            text=True,
            check=True,
            timeout=60,
            env={**os.environ, "LOADED": loaded.name},
        )
        assert done.stderr == ""
        return set(Path(loaded.name).read_text().split())


@pytest.mark.parametrize(
    "statement",
    [
        "import koord",
        "from koord.cli.main import main; assert main(['--help']) == 0",
        "from koord.cli.main import main; assert main(['--version']) == 0",
    ],
)
def test_starting_loads_nothing_heavy(statement: str) -> None:
    extra = modules_after(statement) - modules_after("pass")
    assert "koord" in extra
    heavy = {name for name in extra for root in HEAVY if (name + ".").startswith(f"{root}.")}
    assert heavy == set()


def test_checking_a_program_loads_no_solver() -> None:
    statement = "import koord.cli.check, koord.cli.fmt, koord.cli.explain"
    loaded = modules_after(statement) - modules_after("pass")
    assert "koord.cli.check" in loaded
    assert {"z3", "numpy", "koord.verify"} & loaded == set()


#: What a verification has no use for where all is proved, and nothing else is asked for.
UNUSED_BY_PROOFS = (
    "lark",
    "numpy",
    "llvmlite",
    "scipy",
    "rich",
    "koord.sim",
    "koord.refinement",
    "koord.recheck",
    "koord.runtime.configuration",
    "koord.runtime.deploy",
    "yaml",
    "html",
    "secrets",
    "dataclasses",
    "difflib",
    "inspect",
    "multiprocessing",
    "socket",
    "typing_extensions",
    "koord.verify.export",
    "koord.verify.certificates",
    "koord.verify.instants",
    "koord.verify.engines.bits",
    "koord.verify.engines.horn",
    "koord.verify.engines.explicit.exhaustive",  # all is proved at a glance
    "koord.kernels",
    "koord.syntax.elaboration.candidates",  # nothing is left open in the text
    "koord.syntax.elaboration.unknown_names",
    "koord.syntax.parsing.messages",
    "koord.syntax.printing",
    "koord.semantics.reloading",
    "koord.sampling.constraint_guesses",  # nor is anything sampled that has to be repaired
    "koord.sampling.library",
    "koord.sampling.run_extension",
    "koord.traces.lassos",  # nothing is violated
    "koord.traces.replay",
    "koord.verify.witness",
    "koord.verify.each_claim",
    "koord.verify.engines.bmc",
    "koord.verify.engines.every_n.conditions",
    "koord.verify.engines.every_n.lemma_search",
    "koord.verify.engines.every_n.loops",
    "koord.verify.strategy.few_robots",
    "koord.verify.strategy.rounds_question",
)


#: What the process has no use for that waits for the one that verifies.
UNUSED_BY_WAITING = (
    "z3",
    "ctypes",
    "koord.sampling",
    "koord.verify.encoding",
    "koord.verify.engines",
    "koord.verify.reduction",
    "koord.verify.vacuity",
)


def test_whoever_waits_for_verdicts_loads_nothing_that_finds_them() -> None:
    arguments = ["verify", str(EXAMPLES / "leader_elect.krd")]
    loaded = modules_after(COMMAND.format(arguments=arguments), alone=True)
    assert "koord.verify.strategy.time_limits" in loaded
    heavy = {
        name for name in loaded for root in UNUSED_BY_WAITING if (name + ".").startswith(f"{root}.")
    }
    assert heavy == set()


#: What a simulated fleet of drones has no use for, whose configuration names no plug-ins.
UNUSED_BY_DRONES = ("scipy", "osqp", "pymunk", "importlib.metadata", "email", "rich")


def test_simulating_loads_only_what_the_fleet_uses(tmp_path: Path) -> None:
    agents = "\n".join(f"  - {{pid: {k}, position: [{k}, 0, 1]}}" for k in range(70))
    config = tmp_path / "many.yaml"
    config.write_text(
        f"agents:\n{agents.replace('pid', 'on_device: drone, pid')}\n"
        "devices: {drone: {bot_type: QUAD, planner: RRT_DRONE}}\n"
        "world: {bounds: {low: [-2, -2, 0], high: [72, 2, 3]}}\n"
    )
    program = tmp_path / "still.krd"
    program.write_text(
        "local:\n    int told = 0\n\nSay:\n    pre: told < 1\n    eff:\n        told = 1\n"
    )
    arguments = ["sim", str(program), str(config), "--rounds", "2", "--no-html", "--json"]
    loaded = modules_after(COMMAND.format(arguments=arguments))
    assert "koord.sim.fleet" in loaded
    heavy = {
        name for name in loaded for root in UNUSED_BY_DRONES if (name + ".").startswith(f"{root}.")
    }
    assert heavy == set()


#: What a check has no use for besides: solvers, and what loads them.
SOLVING = ("koord.verify", "z3", "ctypes", "pathlib", "shutil", "tempfile")


@pytest.mark.parametrize("command", ["check", "verify"])
def test_reading_and_proving_load_only_what_they_use(command: str) -> None:
    arguments = [command, str(EXAMPLES / "leader_elect.krd")]
    loaded = modules_after(COMMAND.format(arguments=arguments))
    used = "koord.verify.strategy.verification" if command == "verify" else "koord.cli.check"
    assert used in loaded
    unused = UNUSED_BY_PROOFS if command == "verify" else (*UNUSED_BY_PROOFS, *SOLVING)
    heavy = {name for name in loaded for root in unused if (name + ".").startswith(f"{root}.")}
    assert heavy == set()


def test_a_simulated_run_loads_only_what_it_uses() -> None:
    program = EXAMPLES / "lineform.krd"
    arguments = ["sim", str(program), "--rounds", "1", "--no-html"]
    loaded = modules_after(f"from koord.cli.main import main; assert main({arguments}) == 0")
    assert "koord.sim.running" in loaded
    unused = (
        "ompl",  # nothing is in the way
        "shapely",
        "osqp",
        "scipy",
        "z3",
        "http",
        "koord.verify",
        "koord.refinement",
        "koord.sim.viewing",
    )
    assert loaded & {*unused, "koord.runtime.deploy", "koord.cli.campaigns"} == set()


def test_the_check_would_see_a_heavy_module() -> None:
    assert "lark" in modules_after("import lark")
