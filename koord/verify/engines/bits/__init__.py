"""Finite instances bit by bit: and-inverter graphs, a SAT solver, and IC3."""
