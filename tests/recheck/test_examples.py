"""Certificates of the examples, confirmed by the second solver. [T-SNAPSHOT] [T-COMMIT]"""

from __future__ import annotations

from fractions import Fraction

import jsonschema
import pytest

from koord.recheck.checking import RecheckOutcome
from tests.recheck.certificates import EXAMPLES, document_of, rechecked

pytest.importorskip("cvc5")

SCHEMA = EXAMPLES.parents[1] / "koord" / "api" / "schemas" / "certificate.schema.json"

QUICK = [
    ("hvac.krd", 1, "40"),
    ("leader_elect.krd", 3, "1/10"),
    ("lineform_1d.krd", 3, "10"),
]

SLOW = [
    ("shortest_path.krd", 3, "1/10"),
    ("sum_of_ids.krd", 3, "1/10"),
    ("fischer.krd", 2, "1"),
    ("follow_path.krd", 2, "1/10"),
    ("task.krd", 2, "1/10"),
    ("traffic.krd", 2, "3"),
    ("allstop.krd", 2, "1/10"),
    ("sats.krd", 2, "50"),
    ("allstop.krd", 3, "1/10"),
    ("cars_and_drones.krd", 3, "1/10"),
    ("delivery.krd", 2, "1/10"),
    ("fischer.krd", 3, "1"),
    ("fischer_drift.krd", 2, "1"),
    ("follow_points.krd", 3, "1/10"),
    ("lineform.krd", 4, "1/10"),
    ("mapping.krd", 2, "1/10"),
    ("sats.krd", 3, "50"),
    ("task.krd", 3, "1/10"),
    ("waypoints.krd", 2, "50"),
]


def _cases() -> list[object]:
    quick = [pytest.param(*case, id=f"{case[0]}-{case[1]}") for case in QUICK]
    slow = [pytest.param(*case, id=f"{case[0]}-{case[1]}", marks=pytest.mark.slow) for case in SLOW]
    return [*quick, *slow]


@pytest.mark.parametrize(("file", "robots", "delta"), _cases())
def test_a_certificate_is_confirmed(file: str, robots: int, delta: str) -> None:
    document = document_of(file, robots, Fraction(delta))
    found = rechecked(document)
    assert found.outcome is RecheckOutcome.CONFIRMED, found.reason
    assert {opinion.answer.value for opinion in found.opinions} == {"unsat"}


def test_certificates_have_the_published_form() -> None:
    import json

    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(document_of("allstop.krd", 2), schema)
    jsonschema.validate(document_of("task.krd", 2), schema)
