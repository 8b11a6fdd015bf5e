"""Starting is quick because little is loaded: what weighs stays out until a command needs it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

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
    "numba",
    "hypothesis",
    "koord.syntax",
    "koord.semantics",
    "koord.verify",
    "koord.runtime",
    "koord.sim",
)


def modules_after(statement: str) -> set[str]:
    """The modules that a fresh interpreter has loaded after a statement."""
    program = (
        "import json, sys\n"
        f"{statement}\n"
        "sys.stdout.flush()\n"
        "print('\\n' + json.dumps(sorted(sys.modules)))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stderr == ""
    loaded: list[str] = json.loads(done.stdout.splitlines()[-1])
    return set(loaded)


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
    "numba",
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
    "koord.verify.export",
    "koord.verify.certificates",
    "koord.verify.instants",
    "koord.verify.engines.bits",
    "koord.verify.engines.horn",
)


@pytest.mark.parametrize("command", ["check", "verify"])
def test_reading_and_proving_load_only_what_they_use(command: str) -> None:
    arguments = [command, str(EXAMPLES / "leader_elect.krd")]
    loaded = modules_after(f"from koord.cli.main import main; assert main({arguments}) == 0")
    used = "koord.verify.strategy.time_limits" if command == "verify" else "koord.cli.check"
    assert used in loaded
    unused = UNUSED_BY_PROOFS if command == "verify" else (*UNUSED_BY_PROOFS, "koord.verify", "z3")
    heavy = {name for name in loaded for root in unused if (name + ".").startswith(f"{root}.")}
    assert heavy == set()


def test_a_simulated_run_loads_only_what_it_uses() -> None:
    program = EXAMPLES / "lineform.krd"
    arguments = ["sim", str(program), "--rounds", "1", "--no-html"]
    loaded = modules_after(f"from koord.cli.main import main; assert main({arguments}) == 0")
    assert {"koord.sim.running", "ompl"} <= loaded
    unused = (
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
