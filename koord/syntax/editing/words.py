"""What words of the language mean, for people: a sentence, a form, and the rule that says it."""

from __future__ import annotations

from msgspec import Struct


class Word(Struct, frozen=True):
    """A word: how it is written, what it does, and the id of its rule in ``specs/semantics``."""

    form: str
    meaning: str
    rule: str = ""


#: The words of the language.
WORDS = {
    "agent": Word("agent NAME:", "a kind of robot, with variables, modules and events of its own"),
    "allread": Word(
        "allread:", "variables with an entry for each robot, which it alone writes", "ALLREAD"
    ),
    "allwrite": Word("allwrite:", "variables that all robots share and write", "SHARED-ASSIGN"),
    "and": Word("a and b", "b is evaluated only if a is true", "E-SHORT"),
    "assume": Word(
        "assume: e", "which configurations are initial, or what fair runs do", "PROP-ASSUME"
    ),
    "atomic": Word(
        "atomic:",
        "in each round at most one robot runs a block of the same lock class; for the others the "
        "event does not happen",
        "ATOMIC",
    ),
    "break": Word("break", "leaves the innermost loop", "S-BREAK"),
    "def": Word("def fun f(T x) -> R: …  |  def NAME: …", "a function, or a record", "E-CALL"),
    "eff": Word("eff: …", "the statements of an event", "EVENT-TRANS"),
    "elif": Word("elif e:", "a further branch", "S-IF"),
    "else": Word("else:", "the branch that is left", "S-IF"),
    "enum": Word("enum NAME: a, b", "a type with these values", "VALUE"),
    "eventually": Word(
        "eventually NAME: p  |  eventually NAME: p leadsto q",
        "in every fair run, sooner or later",
        "PROP-EVENTUALLY",
    ),
    "exists": Word("exists i: e", "for one robot, number or element at least", "E-QUANT"),
    "extern": Word(
        "extern  |  extern fresh",
        "a function known by its summary; one that is `fresh` may answer anew at each call",
        "EXTERNAL",
    ),
    "for": Word("for i = 0, n:  |  for x in list:", "a loop", "S-FOR"),
    "forall": Word("forall i: e", "for every robot, number or element", "E-QUANT"),
    "if": Word("if e:", "a branch", "S-IF"),
    "implies": Word("a implies b", "b is evaluated only if a is true", "E-SHORT"),
    "in": Word("for x in list:  |  forall k in 0, n: e", "the range of a variable", "S-FOREACH"),
    "init": Word("init:", "statements that each robot runs before the first round", "INIT"),
    "invariant": Word(
        "invariant NAME: e  |  invariant NAME at round: e",
        "holds in every configuration, or at the ends of rounds",
        "PROP-INVARIANT",
    ),
    "leadsto": Word("p leadsto q", "whenever p holds, q holds then or later", "PROP-LEADS-TO"),
    "local": Word("local:", "variables of each robot, which no other sees", "LOCAL-ASSIGN"),
    "not": Word("not a", "negation", "E-SHORT"),
    "or": Word("a or b", "b is evaluated only if a is false", "E-SHORT"),
    "param": Word("param T x = e", "a constant of a run", "E-CONST"),
    "pass": Word("pass", "an effect that does nothing", "S-SEQ"),
    "pre": Word("pre: e", "when an event may happen", "SELECT"),
    "repeat": Word("repeat n:", "runs its block n times", "S-FOR"),
    "return": Word("return e", "leaves the function", "S-RETURN"),
    "stop": Word("stop", "the robot stops", "STOP"),
    "trystop": Word("trystop()", "all robots stop at once, if all ask for it", "STOP"),
    "urgent": Word("urgent NAME:", "an event that a robot may not skip", "SKIP"),
    "using": Word("using NAME:", "a module: sensors, actuators, a model, contracts", "ENV-TRANS"),
    "sensors": Word("sensors:", "ports that a robot reads", "ENV-FREE"),
    "actuators": Word("actuators:", "ports that a robot writes", "ACTUATE"),
    "environment": Word("environment: …", "the model of a module", "ENV-MODEL"),
    "contract": Word(
        "contract NAME:",
        "if `requires` hold before the environment's turn, `ensures` hold after",
        "ENV-CONTRACT",
    ),
    "requires": Word("requires: e", "what has to hold before", "ENV-CONTRACT"),
    "ensures": Word("ensures: e", "what holds after, where `x'` is port x", "ENV-CONTRACT"),
    "true": Word("true", "a truth value", "E-CONST"),
    "false": Word("false", "a truth value", "E-CONST"),
    "pid": Word("pid", "the robot's own number, from 0", "E-CONST"),
    "numAgents": Word("numAgents", "the number of robots", "E-CONST"),
    "Nsys": Word("Nsys", "the number of robots", "E-CONST"),
    "delta": Word("delta", "the length of a round in seconds", "E-CONST"),
    "pi": Word("pi", "the double nearest to π", "E-CONST"),
    "stopped": Word("stopped@i", "robot i has stopped", "PROP-STOPPED"),
    "result": Word("result", "the answer of an external function, in its summary", "EXTERNAL"),
    "ran": Word("ran(E)@i", "robot i ran the event E in the round just ended", "PROP-RAN"),
    "choose": Word("choose(low, high)", "a fresh value between the bounds", "CHOOSE"),
    "abs": Word("abs(x)", "the absolute value", "E-ARITH"),
    "min": Word("min(x, y, …)  |  min(list)", "the least number", "E-LIST"),
    "max": Word("max(x, y, …)  |  max(list)", "the greatest number", "E-LIST"),
    "clamp": Word("clamp(x, low, high)", "max(low, min(x, high))", "E-ARITH"),
    "length": Word("length(list)", "how many elements or entries", "E-LIST"),
    "len": Word("len(list)", "how many elements or entries", "E-LIST"),
    "contains": Word("contains(list, value)", "an element, or a key of a map", "E-LIST"),
    "any": Word("any(list)", "one truth value is true", "E-LIST"),
    "all": Word("all(list)", "all truth values are true", "E-LIST"),
    "keys": Word("keys(map)", "the keys of a map in the order of its entries", "E-LIST"),
    "float": Word("float(x)", "an int as a float", "E-ARITH"),
    "toList": Word("toList(a, b)", "a list of its arguments", "E-CONST"),
    "append": Word("x.append(v)", "adds an element at the end; writes the whole list", "S-APPEND"),
    "add": Word("set.add(x)", "adds an element to a set", "S-ADD"),
    "remove": Word(
        "x.remove(v)", "removes the first element equal to v, or the entry of a key", "S-REMOVE"
    ),
    "pop": Word("v = pop(x)", "takes the first of a queue, the last of a list", "S-POP"),
    "assign": Word("assign(task, pid)", "marks a task as a robot's", "TASK"),
    "pos": Word("pos(x, y, z)", "a position in metres", "E-CONST"),
    "stdout": Word("stdout << value", "writes a line of output", "OUTPUT"),
}
