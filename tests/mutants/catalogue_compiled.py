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
UNPUT = "tests/runtime/test_unput.py"

COMPILER = (
    Mutant(
        "implication forgets its condition",
        "runtime.compile.expressions._binary",
        'f"not {left.within(NOT)} or {right.within(AND)}"',
        'f"{left.within(AND)} or {right.within(AND)}"',
        (GENERATED,),
    ),
    Mutant(
        "subtraction is not left-associative",
        "runtime.compile.expressions._binary",
        "right.within(level + 1)",
        "right.within(level)",
        (GENERATED,),
    ),
    Mutant(
        "integers divide as floats do",
        "runtime.compile.expressions._division",
        '"/" if of_floats else "//"',
        '"/"',
        (GENERATED,),
    ),
    Mutant(
        "a divisor is not looked at",
        "runtime.compile.expressions._division",
        "isinstance(e.right, core.Const) and e.right.value",
        "isinstance(e.right, core.Const) or e.right.type",
        (FAULTS,),
    ),
    Mutant(
        "a fault is told of at the whole division",
        "runtime.compile.expressions._division",
        "e.right.span",
        "e.span",
        (FAULTS,),
    ),
    Mutant(
        "any index is inside of an array",
        "runtime.compile.expressions.is_inside",
        "isinstance(type_.size, int) and 0 <= value < type_.size",
        "True",
        (FAULTS,),
    ),
    Mutant(
        "a loop's bound is any array's size",
        "runtime.compile.expressions._at_most",
        "value <= size",
        "value >= 0",
        (FAULTS,),
    ),
    Mutant(
        "what is unset is read",
        "runtime.compile.expressions.read",
        'check = "whole" if is_tree(type_) else "known"',
        ('check = "whole"\nif not is_tree(type_):\n    return code'),
        (FAULTS,),
    ),
    Mutant(
        "a key forgets the loops around it",
        "runtime.compile.scope.Scope.key",
        "[str(site), *self.trail]",
        "[str(site)]",
        (GENERATED, EXAMPLES),
    ),
    Mutant(
        "a call is not on the trail",
        "runtime.compile.scope.Scope.trail_to",
        "[*self.trail, str(site)]",
        "[*self.trail]",
        (EXAMPLES,),
    ),
    Mutant(
        "records of floats are equal as tuples are",
        "runtime.compile.expressions._equality",
        "contains(e.left.type, FloatType)",
        "False",
        ("tests/refinement/test_values.py",),
    ),
    Mutant(
        "a list is looked at after what is looked for",
        "runtime.compile.expressions._builtin",
        "plain and not (items.faults and wanted.faults)",
        "plain",
        (FAULTS,),
    ),
    Mutant(
        "an item is appended before it is evaluated",
        "runtime.compile.statements._held_back",
        "not (value.faults and other.faults)",
        "value.faults or not value.faults",
        (FAULTS,),
    ),
    Mutant(
        "a queue is popped at its end",
        "runtime.compile.statements._pop",
        '"first_of" if isinstance(s.place.type, QueueType) else "last_of"',
        '"last_of"',
        (GENERATED,),
    ),
    Mutant(
        "removing nothing is a write",
        "runtime.compile.statements._remove",
        'f"if len({left}) < len({whole.text}):"',
        'f"if len({left}) <= len({whole.text}):"',
        ("tests/refinement/test_values.py",),
    ),
    Mutant(
        "what is set in one branch is set behind both",
        "runtime.compile.statements._if",
        "set.intersection",
        "set.union",
        (GENERATED, "tests/refinement/test_values.py"),
    ),
    Mutant(
        "what a loop sets is set behind it",
        "runtime.compile.statements._for_range",
        "scope.ranges, scope.trail, scope.assigned = outer_ranges, outer_trail, outer",
        "scope.ranges, scope.trail = outer_ranges, outer_trail",
        ("tests/refinement/test_values.py",),
    ),
    Mutant(
        "a model reads what it has written",
        "runtime.compile.program.ProgramModule.environment",
        'first.append(f"{scope.after[slot]} = self.{name}")',
        'scope.after[slot] = f"self.{name}"',
        (GENERATED,),
    ),
    Mutant(
        "urgent events are like others",
        "runtime.compile.program.ProgramModule.events",
        'parts.append("urgent=True")',
        "pass",
        (ROUNDS,),
    ),
    Mutant(
        "INIT is thought to be over while it runs",
        "runtime.compile.program.ProgramModule.initialise",
        "self.scope(number, sure=shared)",
        "self.scope(number)",
        ("tests/refinement/test_values.py",),
    ),
    Mutant(
        "a list that is broken may lack its last comma",
        "runtime.compile.formatting._Layout.items",
        'self.broken(element, indent, "", ",")',
        'self.broken(element, indent, "", "," if len(list(elements)) > 1 else "")',
        (TEXT,),
    ),
)

VALUES = (
    Mutant(
        "negative indices count from the end",
        "runtime.operations.at",
        "0 <= index < len(items)",
        "-len(items) <= index < len(items)",
        (FAULTS,),
    ),
    Mutant(
        "a write below nothing is no fault",
        "runtime.operations.check",
        "raise FaultError(FaultKind.KEY, places[position + 1])",
        "return",
        (FAULTS,),
    ),
    Mutant(
        "every equal element is removed",
        "runtime.operations.without",
        "(*items[:position], *items[position + 1 :])",
        "tuple(i for i in items if not same(i, wanted))",
        ("tests/refinement/test_values.py",),
    ),
    Mutant(
        "NaN is itself",
        "runtime.operations.same",
        "left == right",
        "left is right or left == right",
        ("tests/refinement/test_values.py",),
    ),
    Mutant(
        "large integers are no floats",
        "runtime.operations.real",
        "math.inf if number > 0 else -math.inf",
        "math.inf",
        ("tests/refinement/test_values.py",),
    ),
    Mutant(
        "below a key only the part is written",
        "runtime.robot._to_first_key",
        "path[:position], changed[step]",
        "path[:position], value",
        (ROUNDS,),
    ),
)

ENGINE = (
    Mutant(
        "who is kept out keeps what it did",
        "runtime.robot.Robot.discard",
        '"""Discard the turn: the robot skipped. [SKIP] [ATOMIC]"""',
        (
            '"""Discard the turn: the robot skipped. [SKIP] [ATOMIC]"""\n'
            "for buffer in self._buffers.values():\n"
            "    self.__dict__ = buffer.state"
        ),
        (ROUNDS,),
    ),
    Mutant(
        "an event runs on the robot itself",
        "runtime.robot.Robot._run",
        "self.__dict__ = before",
        "self.__dict__ = buffer.state",
        (ROUNDS,),
    ),
    Mutant(
        "others' writes are not seen",
        "runtime.robot.Robot.commit",
        "self.__dict__.update(changed)",
        "pass",
        (ROUNDS,),
    ),
    Mutant(
        "what is read anew is not kept",
        "runtime.robot.Robot.evolve",
        "value != held[name]",
        "value == held[name]",
        (ROUNDS,),
    ),
    Mutant(
        "models are not asked",
        "runtime.robot.Robot.__init_subclass__",
        "cls.environment is not Robot.environment",
        "cls.environment is Robot.environment",
        (ROUNDS, EXAMPLES),
    ),
    Mutant(
        "trystop undoes stop",
        "runtime.robot.Robot.trystop",
        "self._buffer.asked is StopRequests.NOTHING",
        "self._buffer.asked",
        (ROUNDS,),
    ),
    Mutant(
        "an urgent event has no second",
        "runtime.robot.Robot.propose",
        "buffer not in chosen",
        "not chosen",
        (ROUNDS,),
    ),
    Mutant(
        "an urgent event whose pre faults obliges",
        "runtime.robot.Robot.propose",
        "(b := self.try_event(k)) is not None and not b.in_pre",
        "(b := self.try_event(k)) is not None",
        (ROUNDS,),
    ),
    Mutant(
        "asked twice, a robot answers anew",
        "runtime.robot.Robot.ask",
        "self._answers[key] = from_plain(self.EXTERNALS[function], answer, self.numAgents)",
        "return from_plain(self.EXTERNALS[function], answer, self.numAgents)",
        (ROUNDS,),
    ),
    Mutant(
        "a lock class is never taken",
        "runtime.proposals.decide",
        "taken.update(attempt.locks)",
        "taken.discard(-1)",
        (DECIDING,),
    ),
    Mutant(
        "the first write to a location counts",
        "runtime.proposals.decide",
        "writes += attempt.writes",
        "writes[:0] = attempt.writes",
        (DECIDING,),
    ),
    Mutant(
        "who skips comes first",
        "refinement.running.schedule_of",
        "order += decision.skipped",
        "order = [*decision.skipped, *order]",
        (ROUNDS, GENERATED),
    ),
    Mutant(
        "a list that became shorter grows again",
        "runtime.store.AgreedStore.apply",
        "first = _index(write.path[0])",
        "first = _index(write.path[0])\nitems += [write.value] * (first - len(items) + 1)",
        (STORE,),
    ),
    Mutant(
        "two stores look alike",
        "runtime.store.AgreedStore.digest",
        "whole.encode()",
        "repr(self.layout).encode()",
        (STORE,),
    ),
    Mutant(
        "a variable is in the digest as it was first",
        "runtime.store.AgreedStore.digest",
        "text if one is before else repr(to_plain(v.shape, one))",
        "text",
        (STORE,),
    ),
    Mutant(
        "asking to stop is enough for oneself",
        "runtime.engine.RoundEngine.program_turns",
        "all(r.status is not Status.RUNNING for r in self.robots)",
        "any(r.status is not Status.RUNNING for r in self.robots)",
        (ROUNDS,),
    ),
    Mutant(
        "a fault may be anywhere",
        "refinement.judging._elsewhere",
        "str(fault.span) == place",
        "str(fault.span) != place[:0]",
        (JUDGING,),
    ),
    Mutant(
        "what an event put into a long array is not there when it reads it",
        "runtime.unput.Unput.make",
        "items[index] = new",
        "pass",
        (UNPUT,),
    ),
    Mutant(
        "of two writes to an element of a long array the first counts",
        "runtime.unput.Unput.put",
        "elements[path[0]] = new",
        "elements.setdefault(path[0], new)",
        (UNPUT,),
    ),
    Mutant(
        "a long array that was set as a whole is what it was before",
        "runtime.unput.Unput.put",
        "name in state",
        "name not in self._noted",
        (UNPUT,),
    ),
    Mutant(
        "whoever is asked sees a robot without its long arrays",
        "runtime.unput.Unput.make_all",
        "self.make(state, name)",
        "pass",
        (UNPUT,),
    ),
)

COMPILED = COMPILER + VALUES + ENGINE
