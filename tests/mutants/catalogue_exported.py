"""Mistakes in what is enclosed in certificates, written for other tools, and said of other ways."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

DAMAGE = "tests/recheck/test_damage.py"
CRASHING = "tests/recheck/test_crashing.py"
WAYS = "tests/verify/strategy/test_verification.py"
SCRIPTS = "tests/verify/export/test_smtlib.py"
EXPORTS = "tests/cli/test_exporting.py"

EXPORTED = (
    # certificates
    Mutant(
        "scripts that are not settled are passed over",
        "recheck.checking._joined",
        "SolverAnswer.UNKNOWN",
        "None",
        (DAMAGE, CRASHING),
    ),
    Mutant(
        "scripts that cannot be read are passed over",
        "recheck.checking._read",
        'problems += refusal("K941", certificate.name, message, REWRITE).diagnostics',
        '_ = refusal("K941", certificate.name, message, REWRITE).diagnostics',
        (DAMAGE,),
    ),
    Mutant(
        "a script need not have its digest",
        "recheck.certificate._scripts",
        '_certified(part, "smt2")',
        'part.field("smt2").text()',
        (DAMAGE,),
    ),
    Mutant(
        "a script may ask before it says anything",
        "recheck.script.harmless",
        '"check-sat" in heads and head != "exit"',
        'head == "get-model"',
        (DAMAGE,),
    ),
    Mutant(
        "a crash takes a refutation with it",
        "recheck.obligations.Settling._told",
        (
            "try:\n"
            "    if news or definitions:\n"
            "        self.session.tell([*news, *definitions])\n"
            "    value = self.session.values([text])[0]\n"
            "except SolverEndedError as error:  # what it found stands\n"
            '    yield f"{one.what} is not known, nor what comes after it: {error} when it '
            'was asked"\n'
            "    return"
        ),
        (
            "try:\n"
            "    if news or definitions:\n"
            "        self.session.tell([*news, *definitions])\n"
            "    value = self.session.values([text])[0]\n"
            "except KeyError as error:\n"
            '    yield f"{one.what} is not known, nor what comes after it: {error} when it '
            'was asked"\n'
            "    return"
        ),
        (CRASHING,),
    ),
    # ways to break a claim
    Mutant(
        "other ways are looked for beyond the bound",
        "verify.engines.bmc.engine._others",
        "moment.configuration.round >= ledger.bounds.rounds",
        "moment.configuration.round > ledger.bounds.rounds",
        (WAYS,),
    ),
    Mutant(
        "there are no more ways when enough were found",
        "verify.engines.bmc.engine.others",
        "EnumerationResult(complete=False)",
        "EnumerationResult(complete=True)",
        (WAYS,),
    ),
    # other tools
    Mutant(
        "what is required later hides what breaks before",
        "verify.encoding.solver.Solver.layered",
        "required[start : layer.required]",
        "required",
        (SCRIPTS,),
    ),
    Mutant(
        "only the last round is asked about",
        "verify.encoding.solver.Solver.layered",
        "z3.Or(self.d.boolean(layer.asked), whole)",
        "whole if layer is not layers[-1] else self.d.boolean(layer.asked)",
        (SCRIPTS,),
    ),
    Mutant(
        "numbers beyond a range are passed over",
        "verify.engines.bits.circuit._is_loose",
        "isinstance(leaf, Wild) or (isinstance(leaf, Ranged) and leaf.strays)",
        "isinstance(leaf, Wild)",
        (EXPORTS,),
    ),
)
