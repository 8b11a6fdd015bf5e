"""The catalogue of diagnostics of programs: one story for each code."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from koord.syntax import (
    catalogue_costs,
    catalogue_declarations,
    catalogue_names,
    catalogue_properties,
    catalogue_statements,
    catalogue_syntax,
    catalogue_values,
    catalogue_warnings,
)
from koord.syntax.catalogue_entry import Entry

#: Every code that reading and elaborating a program can give, with its story.
CATALOGUE: Mapping[str, Entry] = MappingProxyType(
    {
        **catalogue_syntax.ENTRIES,
        **catalogue_names.ENTRIES,
        **catalogue_statements.ENTRIES,
        **catalogue_values.ENTRIES,
        **catalogue_declarations.ENTRIES,
        **catalogue_costs.ENTRIES,
        **catalogue_properties.ENTRIES,
        **catalogue_warnings.ENTRIES,
    }
)


def explain(code: str) -> Entry | None:
    """The story of a code, in any case of letters; None if there is no such code."""
    return CATALOGUE.get(code.strip().upper())
