"""Importing this raises KoordError where libraries are missing that worlds are simulated with."""

from koord.runtime.motion.libraries import SIM, require

require(SIM, "sim")
