"""Random typed core programs that use every construct of the language."""
