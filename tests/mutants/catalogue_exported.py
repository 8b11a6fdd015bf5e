"""Mistakes in what is enclosed in certificates, written for other tools, and said of other ways."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

DAMAGE = "tests/recheck/test_damage.py"
CRASHING = "tests/recheck/test_crashing.py"
WAYS = "tests/verify/test_portfolio.py"
SCRIPTS = "tests/verify/test_scripts.py"
EXPORTS = "tests/cli/test_exporting.py"

EXPORTED = (
    # certificates
    Mutant(
        "scripts that are not settled are passed over",
        "recheck/checking.py",
        "if opinion.answer is Answer.UNKNOWN:",
        "if opinion.answer is None:",
        (DAMAGE, CRASHING),
    ),
    Mutant(
        "scripts that cannot be read are passed over",
        "recheck/checking.py",
        "problems += refusal(",
        "_ = refusal(",
        (DAMAGE,),
    ),
    Mutant(
        "a script need not have its digest",
        "recheck/certificate.py",
        'given[name] = Given(name, _certified(part, "smt2"))',
        'given[name] = Given(name, part.field("smt2").text())',
        (DAMAGE,),
    ),
    Mutant(
        "a script may ask before it says anything",
        "recheck/commands.py",
        'if "check-sat" in heads and head != "exit":',
        'if head == "get-model":',
        (DAMAGE,),
    ),
    Mutant(
        "a crash takes a refutation with it",
        "recheck/settling.py",
        "except SolverEndedError as error:  # what it found stands",
        "except KeyError as error:",
        (CRASHING,),
    ),
    # ways to break a claim
    Mutant(
        "other ways are looked for beyond the bound",
        "verify/varieties.py",
        "if is_end and moment.configuration.round >= ledger.bounds.rounds:",
        "if is_end and moment.configuration.round > ledger.bounds.rounds:",
        (WAYS,),
    ),
    Mutant(
        "there are no more ways when enough were found",
        "verify/varieties.py",
        "return tuple(found), Ways(complete=False)\n",
        "return tuple(found), Ways(complete=True)\n",
        (WAYS,),
    ),
    # other tools
    Mutant(
        "what is required later hides what breaks before",
        "verify/solving.py",
        "whole = z3.And(*required[start : layer.required], here)",
        "whole = z3.And(*required, here)",
        (SCRIPTS,),
    ),
    Mutant(
        "only the last round is asked about",
        "verify/solving.py",
        "here = z3.Or(self.d.boolean(layer.asked), whole)",
        "here = whole if layer is not layers[-1] else self.d.boolean(layer.asked)",
        (SCRIPTS,),
    ),
    Mutant(
        "numbers beyond a range are passed over",
        "verify/bits/transition.py",
        "return isinstance(leaf, Wild) or (isinstance(leaf, Ranged) and leaf.strays)",
        "return isinstance(leaf, Wild)",
        (EXPORTS,),
    ),
)
