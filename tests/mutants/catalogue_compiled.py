"""Seeded mistakes in the compiler, in what compiled programs are made of, and in their engine."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

GENERATED = "tests/refinement/test_generated.py"
FAULTS = "tests/refinement/test_faults.py"
ROUNDS = "tests/refinement/test_rounds.py"
EXAMPLES = "tests/refinement/test_examples.py"
JUDGING = "tests/refinement/test_judging.py"
STORE = "tests/runtime/test_store.py"
DECIDING = "tests/runtime/test_deciding.py"
TEXT = "tests/runtime/compile/test_text.py"

COMPILER = (
    Mutant(
        "implication forgets its condition",
        "runtime/compile/expressions.py",
        'return Code(f"not {left.within(NOT)} or {right.within(AND)}", OR, faults)',
        'return Code(f"{left.within(AND)} or {right.within(AND)}", OR, faults)',
        (GENERATED,),
    ),
    Mutant(
        "subtraction is not left-associative",
        "runtime/compile/expressions.py",
        'return Code(f"{left.within(first)} {word} {right.within(level + 1)}", level, faults)',
        'return Code(f"{left.within(first)} {word} {right.within(level)}", level, faults)',
        (GENERATED,),
    ),
    Mutant(
        "integers divide as floats do",
        "runtime/compile/expressions.py",
        'word = "%" if e.op is BinaryOp.MOD else "/" if of_floats else "//"',
        'word = "%" if e.op is BinaryOp.MOD else "/"',
        (GENERATED,),
    ),
    Mutant(
        "a divisor is not looked at",
        "runtime/compile/expressions.py",
        "if isinstance(e.right, core.Const) and e.right.value:",
        "if isinstance(e.right, core.Const) or e.right.type:",
        (FAULTS,),
    ),
    Mutant(
        "a fault is told of at the whole division",
        "runtime/compile/expressions.py",
        "where = Code(scope.place(e.right.span))",
        "where = Code(scope.place(e.span))",
        (FAULTS,),
    ),
    Mutant(
        "any index is inside of an array",
        "runtime/compile/expressions.py",
        "return isinstance(type_.size, int) and 0 <= value < type_.size",
        "return True",
        (FAULTS,),
    ),
    Mutant(
        "a loop's bound is any array's size",
        "runtime/compile/expressions.py",
        "return isinstance(size, int) and value <= size",
        "return isinstance(size, int) and value >= 0",
        (FAULTS,),
    ),
    Mutant(
        "what is unset is read",
        "runtime/compile/expressions.py",
        'check = "whole" if is_tree(type_) else "known"',
        'check = "whole"\n        if not is_tree(type_):\n            return code',
        (FAULTS,),
    ),
    Mutant(
        "a key forgets the loops around it",
        "runtime/compile/expressions.py",
        "return tuple_of([str(site), *self.trail])",
        "return tuple_of([str(site)])",
        (GENERATED, EXAMPLES),
    ),
    Mutant(
        "a call is not on the trail",
        "runtime/compile/expressions.py",
        "return tuple_of([*self.trail, str(site)])",
        "return tuple_of([*self.trail])",
        (EXAMPLES,),
    ),
    Mutant(
        "records of floats are equal as tuples are",
        "runtime/compile/spelling.py",
        "        case FloatType():\n            return True",
        "        case FloatType():\n            return False",
        ("tests/refinement/test_values.py",),
    ),
    Mutant(
        "a list is looked at after what is looked for",
        "runtime/compile/expressions.py",
        "if plain and not (items.faults and wanted.faults):",
        "if plain:",
        (FAULTS,),
    ),
    Mutant(
        "an item is appended before it is evaluated",
        "runtime/compile/statements.py",
        "if not (value.faults and other.faults):",
        "if value.faults or not value.faults:",
        (FAULTS,),
    ),
    Mutant(
        "a queue is popped at its end",
        "runtime/compile/statements.py",
        'name = "first_of" if isinstance(s.place.type, QueueType) else "last_of"',
        'name = "last_of"',
        (GENERATED,),
    ),
    Mutant(
        "removing nothing is a write",
        "runtime/compile/statements.py",
        'f"if len({left}) < len({whole.text}):"',
        'f"if len({left}) <= len({whole.text}):"',
        ("tests/refinement/test_values.py",),
    ),
    Mutant(
        "what is set in one branch is set behind both",
        "runtime/compile/statements.py",
        "scope.assigned = set.intersection(*ends) if ends else before",
        "scope.assigned = set.union(*ends) if ends else before",
        (GENERATED, "tests/refinement/test_values.py"),
    ),
    Mutant(
        "what a loop sets is set behind it",
        "runtime/compile/statements.py",
        "    scope.ranges, scope.trail, scope.assigned = outer_ranges, outer_trail, outer\n"
        "    first = ",
        "    scope.ranges, scope.trail = outer_ranges, outer_trail\n    first = ",
        ("tests/refinement/test_values.py",),
    ),
    Mutant(
        "a model reads what it has written",
        "runtime/compile/program.py",
        'first.append(f"{scope.after[slot]} = self.{name}")',
        'scope.after[slot] = f"self.{name}"',
        (GENERATED,),
    ),
    Mutant(
        "urgent events are like others",
        "runtime/compile/program.py",
        'parts.append("urgent=True")',
        "pass",
        (ROUNDS,),
    ),
    Mutant(
        "INIT is thought to be over while it runs",
        "runtime/compile/program.py",
        "scope = self.scope(number, sure=shared)",
        "scope = self.scope(number)",
        ("tests/refinement/test_values.py",),
    ),
    Mutant(
        "a list that is broken may lack its last comma",
        "runtime/compile/formatting.py",
        'for line in self.broken(element, indent, "", ",")]',
        'for line in self.broken(element, indent, "", "," if len(list(elements)) > 1 else "")]',
        (TEXT,),
    ),
)

VALUES = (
    Mutant(
        "negative indices count from the end",
        "runtime/operations.py",
        "if 0 <= index < len(items):",
        "if -len(items) <= index < len(items):",
        (FAULTS,),
    ),
    Mutant(
        "a write below nothing is no fault",
        "runtime/operations.py",
        "                raise FaultError(FaultKind.KEY, places[position + 1])",
        "                return",
        (FAULTS,),
    ),
    Mutant(
        "every equal element is removed",
        "runtime/operations.py",
        "return (*items[:position], *items[position + 1 :])\n    return items",
        "return tuple(i for i in items if not same(i, wanted))\n    return items",
        ("tests/refinement/test_values.py",),
    ),
    Mutant(
        "NaN is itself",
        "runtime/operations.py",
        "    return left == right\n",
        "    return left is right or left == right\n",
        ("tests/refinement/test_values.py",),
    ),
    Mutant(
        "large integers are no floats",
        "runtime/operations.py",
        "return math.inf if number > 0 else -math.inf",
        "return math.inf",
        ("tests/refinement/test_values.py",),
    ),
    Mutant(
        "below a key only the part is written",
        "runtime/robot.py",
        "            return path[:position], changed[step]",
        "            return path[:position], value",
        (ROUNDS,),
    ),
)

ENGINE = (
    Mutant(
        "who is kept out keeps what it did",
        "runtime/robot.py",
        "        self.__dict__.update(changed)\n        self.ran = None",
        "        for buffer in self._buffers.values():\n            self.__dict__ = buffer.state\n"
        "        self.__dict__.update(changed)\n        self.ran = None",
        (ROUNDS,),
    ),
    Mutant(
        "an event runs on the robot itself",
        "runtime/robot.py",
        "            self.__dict__ = before\n        # A decision",
        "            self.__dict__ = buffer.state\n        # A decision",
        (ROUNDS,),
    ),
    Mutant(
        "others' writes are not seen",
        "runtime/robot.py",
        "        self.__dict__ = buffer.state\n        self.__dict__.update(changed)",
        "        self.__dict__ = buffer.state",
        (ROUNDS,),
    ),
    Mutant(
        "what is read anew is not kept",
        "runtime/robot.py",
        "                if name in self._ordered or value != held[name]:",
        "                if name in self._ordered or value == held[name]:",
        (ROUNDS,),
    ),
    Mutant(
        "models are not asked",
        "runtime/robot.py",
        "cls._modelled = cls.environment is not Robot.environment",
        "cls._modelled = cls.environment is Robot.environment",
        (ROUNDS, EXAMPLES),
    ),
    Mutant(
        "trystop undoes stop",
        "runtime/robot.py",
        "if self._buffer.asked is Asked.NOTHING:",
        "if self._buffer.asked:",
        (ROUNDS,),
    ),
    Mutant(
        "an urgent event has no second",
        "runtime/robot.py",
        "chosen += [buffer for buffer in owed if buffer not in chosen]",
        "chosen += [buffer for buffer in owed if not chosen]",
        (ROUNDS,),
    ),
    Mutant(
        "an urgent event whose pre faults obliges",
        "runtime/robot.py",
        "if (b := self.try_event(k)) is not None and not b.in_pre]",
        "if (b := self.try_event(k)) is not None]",
        (ROUNDS,),
    ),
    Mutant(
        "asked twice, a robot answers anew",
        "runtime/robot.py",
        "            self._answers[key] = from_plain(self.EXTERNALS",
        "            return from_plain(self.EXTERNALS",
        (ROUNDS,),
    ),
    Mutant(
        "a lock class is never taken",
        "runtime/deciding.py",
        "taken.update(attempt.locks)",
        "taken.discard(-1)",
        (DECIDING,),
    ),
    Mutant(
        "the first write to a location counts",
        "runtime/deciding.py",
        "        writes += attempt.writes\n",
        "        writes[:0] = attempt.writes\n",
        (DECIDING,),
    ),
    Mutant(
        "who skips comes first",
        "refinement/running.py",
        "order += decision.skipped",
        "order = [*decision.skipped, *order]",
        (ROUNDS, GENERATED),
    ),
    Mutant(
        "a list that became shorter grows again",
        "runtime/store.py",
        "if first < len(items):",
        "items += [write.value] * (first - len(items) + 1)\n                if first < len(items):",
        (STORE,),
    ),
    Mutant(
        "two stores look alike",
        "runtime/store.py",
        "return blake2b(repr(self.snapshot()).encode(), digest_size=DIGEST_BYTES).digest()",
        "return blake2b(repr(self.layout).encode(), digest_size=DIGEST_BYTES).digest()",
        (STORE,),
    ),
    Mutant(
        "asking to stop is enough for oneself",
        "runtime/engine/fleet.py",
        "if self.ended is None and all(r.status is not Status.RUNNING for r in self.robots):",
        "if self.ended is None and any(r.status is not Status.RUNNING for r in self.robots):",
        (ROUNDS,),
    ),
    Mutant(
        "a fault may be anywhere",
        "refinement/judging.py",
        "if str(fault.span) == place:",
        "if str(fault.span) != place[:0]:",
        (JUDGING,),
    ),
)

COMPILED = COMPILER + VALUES + ENGINE
