"""Seeded mistakes in what is told of runs, kept of them, and checked of configurations."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

STANDING = "tests/cli/test_standing.py"
CLEARANCE = "tests/runtime/motion/test_clearance.py"
CONFIG = "tests/cli/test_config.py"
CAMPAIGNS = "tests/cli/test_campaigns.py"
PARTS = "tests/semantics/test_parts.py"
RECORDS = "tests/runtime/test_records_parts.py"

SIMULATED = (
    Mutant(
        "who is alone may take a path of no points",
        "runtime/motion/clearance.py",
        "return bool(path) and all(",
        "return all(",
        (CLEARANCE,),
    ),
    Mutant(
        "a target without a way leaves no plight",
        "runtime/motion/group.py",
        "self.plights[robot] = Plight(why, target)",
        "self.plights.pop(robot, None)",
        (STANDING,),
    ),
    Mutant(
        "who was stuck once is stuck for ever",
        "sim/standing.py",
        "self._stuck.pop(pid, None)",
        "pass",
        (STANDING,),
    ),
    Mutant(
        "who stands still ends a run as well as who arrives",
        "cli/concluding.py",
        "return Exit.STUCK if simulation.standing else Exit.OK",
        "return Exit.OK",
        (STANDING,),
    ),
    Mutant(
        "deployed runs may begin otherwise than their programs assume",
        "cli/deploy.py",
        "    check_start(found)\n",
        "",
        (CONFIG,),
    ),
    Mutant(
        "runs of any campaign go on in a file",
        "cli/campaign_files.py",
        "if campaign != self._campaign:",
        "if campaign is None:",
        (CAMPAIGNS,),
    ),
    Mutant(
        "a round that was torn is read",
        "semantics/traces/parts.py",
        "if lines and not _is_whole(lines[-1]):",
        "if not lines:",
        (PARTS,),
    ),
    Mutant(
        "what is cut off counts as whole",
        "cli/traces.py",
        ", cut_off=True)",
        ")",
        (PARTS,),
    ),
    Mutant(
        "what grows has rounds twice",
        "semantics/traces/parts.py",
        "encode_rounds(trace, self._rounds)",
        "encode_rounds(trace)",
        (PARTS,),
    ),
    Mutant(
        "the tail of a recording stays in it",
        "runtime/records.py",
        "        self._file.seek(end)\n",
        "",
        (RECORDS,),
    ),
)
