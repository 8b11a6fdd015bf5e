"""The localisers that koord has."""
