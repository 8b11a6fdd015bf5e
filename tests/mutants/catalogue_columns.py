"""Mistakes in the machine code of programs, and in the columns that it reads."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

TURNS = "tests/runtime/test_columns.py"
RUNS = "tests/sim/test_kernels.py"

COLUMNS = (
    Mutant(
        "machine code is sure of integers of more than 64 bits",
        "runtime.compile.machine.expressions.checked",
        "body.doubt_if(body.b.extract_value(pair, 1))",
        "pass",
        (TURNS,),
    ),
    Mutant(
        "the least integer is divided by -1",
        "runtime.compile.machine.expressions._divided",
        "body.doubt_if(too_large)",
        "left = b.select(too_large, word(0), left)",
        (TURNS,),
    ),
    Mutant(
        "machine code divides integers by zero",
        "runtime.compile.machine.expressions._divided",
        "body.doubt_if(b.icmp_signed('==', right, word(0)))",
        "right = b.select(b.icmp_signed('==', right, word(0)), word(1), right)",
        (TURNS,),
    ),
    Mutant(
        "machine code keeps what is no number",
        "runtime.compile.machine.body.Body.store",
        "cells.is_banked",
        "False",
        (TURNS,),
    ),
    Mutant(
        "columns know what is no number",
        "runtime.columns.columns._is_known",
        "leaf is Leaf.BOOL or not math.isnan(part)",
        "True",
        (TURNS,),
    ),
    Mutant(
        "machine code reads what is not set",
        "runtime.compile.machine.body.Body.load",
        "self.doubt_if(b.icmp_unsigned('!=', known, constant(I8, KNOWN)))",
        "pass",
        (TURNS,),
    ),
    Mutant(
        "machine code reads behind arrays",
        "runtime.compile.machine.expressions.located",
        "body.b.icmp_unsigned('>=', at, word(type_.size))",
        "body.b.icmp_signed('>', at, word(type_.size))",
        (TURNS,),
    ),
    Mutant(
        "machine code reads entries of robots that there are not",
        "runtime.compile.machine.expressions.located",
        "body.b.icmp_unsigned('>=', robot, body.count)",
        "body.bit(False)",
        (TURNS,),
    ),
    Mutant(
        "an event runs though one before it is in doubt",
        "runtime.columns.engine._chosen",
        "_IN_DOUBT if first & doubtful else first.bit_length() - 1",
        "first.bit_length() - 1 if enabled else _IN_DOUBT",
        (TURNS,),
    ),
    Mutant(
        "the last event that is enabled runs",
        "runtime.columns.engine._chosen",
        "some & -some",
        "1 << some.bit_length() - 1",
        (TURNS,),
    ),
    Mutant(
        "columns choose among urgent events",
        "runtime.columns.engine._chosen",
        "some & urgent",
        "False",
        (TURNS,),
    ),
    Mutant(
        "who is not willing runs by machine code",
        "runtime.columns.engine._chosen",
        "not willing or not some",
        "not some",
        (TURNS,),
    ),
    Mutant(
        "machine code takes no locks",
        "runtime.columns.effects._bits",
        "tuple((k for k in range(word.bit_length()) if word >> k & 1))",
        "()",
        (TURNS,),
    ),
    Mutant(
        "the first robot of a fleet is always first",
        "runtime.columns.engine.ColumnEngine._rotated",
        "self.round % count if count else 0",
        "0",
        (TURNS,),
    ),
    Mutant(
        "behind a fault robots skip that were not asked",
        "runtime.columns.deciding.decided",
        "decision.fault is not None",
        "False",
        (TURNS,),
    ),
    Mutant(
        "of two zeros machine code takes the second",
        "runtime.compile.machine.expressions._of_floats",
        "b.fcmp_ordered('<', right, left)",
        "b.fcmp_ordered('<=', right, left)",
        (TURNS,),
    ),
    Mutant(
        "machine code rounds to zero",
        "runtime.compile.machine.expressions._divided",
        "b.select(is_off, b.sub(whole, word(1)), whole)",
        "whole",
        (TURNS,),
    ),
    Mutant(
        "events do not see what they have written",
        "runtime.compile.machine.turns._Making._banked",
        "body.banked[id(column)] = own",
        "body.banked[id(column)] = own if variable.home is Home.ALLREAD else body.cells_at("
        "body.as_words(words), flags, 0)",
        (TURNS,),
    ),
    Mutant(
        "what was stored in a function stays there",
        "runtime.compile.machine.expressions._call",
        "body.forget(body.bound(variable), variable.type, flags=0)",
        "body.bound(variable)",
        (TURNS,),
    ),
    Mutant(
        "columns forget what machine code has written",
        "runtime.columns.columns.Columns.take_deed",
        "not kept or not len(rows)",
        "True",
        (TURNS,),
    ),
    Mutant(
        "columns keep what was not let through",
        "runtime.columns.engine.ColumnEngine._conclude",
        "[row for row, pid in enumerate(deed.pids) if pid in ran]",
        "[*range(len(deed.pids))]",
        (TURNS,),
    ),
    Mutant(
        "columns do not hear of shared variables",
        "runtime.columns.columns.Columns.take_writes",
        "whole.add(name)",
        "pass",
        (TURNS,),
    ),
    Mutant(
        "columns hear of half of what is sensed",
        "runtime.columns.columns.Columns.measure",
        "self._measure(column, one)",
        "column.leaves[0] is Leaf.BOOL and self._measure(column, one)",
        (RUNS,),
    ),
    Mutant(
        "whoever has stopped goes on by machine code",
        "runtime.columns.engine._Fleet.settle",
        "pids[~self.is_stopped[pids]]",
        "pids",
        (TURNS,),
    ),
    Mutant(
        "robots that were blocked seem to have been so before",
        "runtime.columns.engine.ColumnEngine.program_turns",
        "self.robots[pid].rest()",
        "pass",
        (TURNS,),
    ),
)
