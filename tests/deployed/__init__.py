"""Deployed robots as real processes, with a network between them that tests are in charge of."""
