"""A guard module: importing it raises KoordError where simulation libraries are missing."""

from koord.runtime.motion.libraries import SIM, require

require(SIM, "sim")
