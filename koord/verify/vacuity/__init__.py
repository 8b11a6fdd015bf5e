"""Vacuity: verdicts that say less than they seem to. [PROP-VACUOUS]"""
