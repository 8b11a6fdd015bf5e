"""Schemas of documents: made of the structs that koord writes and reads them with.

`python -m tests.api.test_documents` writes the published ones anew.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from koord.api import documents
from koord.api.documents import GENERATED, generated, schema


@pytest.mark.parametrize("document", GENERATED)
def test_the_published_schema_is_that_of_the_structs(document: str) -> None:
    assert schema(document) == generated(document)


if __name__ == "__main__":
    folder = Path(documents.__file__).parent / "schemas"
    for name in GENERATED:
        text = json.dumps(generated(name), indent=1) + "\n"
        (folder / f"{name}.schema.json").write_text(text, encoding="utf-8")
