"""Random typed core programs, configurations and runs, for agreement tests."""
