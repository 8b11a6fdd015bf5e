"""What the checks that prove something have in common: their exit code."""

from __future__ import annotations

from typing import TYPE_CHECKING

from koord.cli.exits import Exit

if TYPE_CHECKING:
    from koord.api.proofs import Proof


def code_of_proof(proof: Proof) -> Exit:
    """The exit code of a proof with its explorations."""
    if proof.interrupted:
        return Exit.INTERRUPTED
    if proof.ok:
        return Exit.OK
    return Exit.VIOLATED if proof.refuted or proof.violations else Exit.UNKNOWN
