"""The stories of K232 to K250: declarations of programs, modules, functions, params."""

from __future__ import annotations

from koord.syntax.catalogue_entry import Entry, error

ENTRIES: dict[str, Entry] = {
    entry.code: entry
    for entry in (
        error(
            "K232",
            "a section has no place here",
            """A file of properties (given with `--with`) holds assumptions, properties, params and
            functions: what the program is made of belongs to the program. `agent` blocks stand at
            the left margin, not in each other.""",
            """
            # koord check app.krd --with THIS FILE
            local:
              int count = 0
            invariant: count >= 0
            """,
            """
            # koord check app.krd --with THIS FILE
            param int most = 4
            invariant: numAgents > 0 or most > 0
            """,
        ),
        error(
            "K234",
            "a `param` has a type that it cannot have",
            """A param is a constant that can be set from outside, so its value can be written
            down: a number, a truth value, a string, a position, a member of an enumeration, or a
            list of these.""",
            """
            param Map<int, int> costs = {}
            Go:
              pre: costs[0] > 1
              eff: stop
            """,
            """
            param int[] costs = [3, 1, 2]
            Go:
              pre: costs[0] > 1
              eff: stop
            """,
        ),
        error(
            "K235",
            "a `param` has no value",
            """A param without a value in its declaration gets one with `--set` or from the
            configuration. Here there was none.""",
            """
            param int tasks
            Go:
              pre: tasks > 3
              eff: stop
            """,
            """
            param int tasks = 4
            Go:
              pre: tasks > 3
              eff: stop
            """,
        ),
        error(
            "K236",
            "a setting names no `param`",
            """`--set name=value` gives a value to a `param` that the program declares. It cannot
            change variables or numbers in the text.""",
            """
            # koord check … --set tsaks=10
            param int tasks = 4
            Go:
              pre: tasks > 3
              eff: stop
            """,
            """
            # koord check … --set tasks=10
            param int tasks = 4
            Go:
              pre: tasks > 3
              eff: stop
            """,
        ),
        error(
            "K237",
            "a setting has the wrong type",
            "The value that `--set` gives has the type of the `param`; an `int` may stand for a "
            "`float`.",
            """
            # koord check … --set tasks=many
            param int tasks = 4
            Go:
              pre: tasks > 3
              eff: stop
            """,
            """
            # koord check … --set tasks=10
            param int tasks = 4
            Go:
              pre: tasks > 3
              eff: stop
            """,
        ),
        error(
            "K238",
            "a stream is used as a value",
            """A stream is a port that `<<` writes to: `stdout`, or an actuator of type `stream`.
            It holds no value: it is not read, assigned, compared or declared as a variable.""",
            """
            using Log
            Tell:
              eff: stdout = "here"
            """,
            """
            using Log
            Tell:
              eff: stdout << "here"
            """,
        ),
        error(
            "K239",
            "an environment reaches beyond its ports",
            """An `environment:` block says how the ports of its module go on during one round. It
            reads ports and `delta`, and writes the ports of its own module. What the program knows
            reaches it through actuators, as in the world.""",
            """
            local:
              float power = 1
            using Heater:
              sensors:
                float temp
              environment:
                temp = temp + power * delta
            Raise:
              eff: power = power + 1
            """,
            """
            using Heater:
              sensors:
                float temp
              actuators:
                float power
              environment:
                temp = temp + power * delta
            Raise:
              eff: power = temp + 1
            """,
        ),
        error(
            "K240",
            "a function is declared wrongly",
            """An external function has a result, and may have a summary: `requires:` and
            `ensures:`. A function with a body has none, since what it computes is known. Parameters
            have no initial values.""",
            """
            def fun near(pos a, pos b):
              extern
            """,
            """
            def fun near(pos a, pos b) -> bool:
              extern
            """,
        ),
        error(
            "K241",
            "a record is a part of itself",
            """A value of such a record would never end. Let it hold the number of the other one,
            an index into a list.""",
            """
            def Node:
              int load
              Node[] next
            """,
            """
            def Node:
              int load
              int[] next
            """,
        ),
        error(
            "K243",
            "not all robots have this",
            """In a program with several kinds of robot, `v@i` for any robot `i`, or `v` alone in a
            property outside of an `agent` block, wants a variable or port that all kinds have,
            with one type. For one kind, say which: `forall Car c: v@c > 0`.""",
            """
            agent Car:
              local:
                float fuel = 1
              Drive:
                eff: fuel = fuel / 2
            agent Drone:
              Fly:
                eff: stop
            invariant: forall i: fuel@i > 0
            """,
            """
            agent Car:
              local:
                float fuel = 1
              Drive:
                eff: fuel = fuel / 2
            agent Drone:
              Fly:
                eff: stop
            invariant: forall Car c: fuel@c > 0
            """,
        ),
        error(
            "K244",
            "an `allread` variable was meant to hold a list for each robot",
            """Under `allread:`, the array that a declaration shows is the one over the robots:
            `pos[] route` is one `pos` for each robot. Where each robot shares a path, which is a
            `pos[]` itself, the variable is an array of arrays: `pos[][] route`.""",
            """
            using Motion
            allread:
              pos[] route
            Plan:
              eff: route[pid] = findPath(Motion.psn, pos(0, 0, 0))
            """,
            """
            using Motion
            allread:
              pos[][] route
            Plan:
              eff: route[pid] = findPath(Motion.psn, pos(0, 0, 0))
            """,
        ),
        error(
            "K245",
            "the library's function does not fit this `Task`",
            """`Task` is predefined, and a program may declare its own. Functions of the library
            that work on tasks then use the fields that it has: `allAssigned` wants a `bool
            assigned`, for one.""",
            """
            def Task:
              pos loc
            allwrite:
              Task[] list = []
            Finish:
              pre: allAssigned(list)
              eff: stop
            """,
            """
            def Task:
              pos loc
              bool assigned = false
            allwrite:
              Task[] list = []
            Finish:
              pre: allAssigned(list)
              eff: stop
            """,
        ),
        error(
            "K246",
            "the world has another number of tasks",
            """An `allwrite` array of tasks without an initial value starts with the tasks that the
            configuration lists under `world: tasks:`, so there are as many. A list, `Task[]`, takes
            any number.""",
            """
            # with a configuration that lists 3 tasks
            allwrite:
              Task[4] list
            Finish:
              pre: allAssigned(list)
              eff: stop
            """,
            """
            # with a configuration that lists 3 tasks
            allwrite:
              Task[] list
            Finish:
              pre: allAssigned(list)
              eff: stop
            """,
        ),
        error(
            "K250",
            "what a program is meant for is stated wrongly",
            """`param int numAgents = 4` states how many robots a program is meant for, and `param
            float delta = 40` how many seconds a round of them takes: what holds without
            `--robots` and `--delta`. Kinds of robot state the number in their `agent` blocks, each
            its own. There are 1 to 10,000 robots, and a round is longer than 0 seconds.""",
            """
            agent Car:
              param int numAgents = 2
              Drive:
                eff: stop
            agent Drone:
              Fly:
                eff: stop
            """,
            """
            param float delta = 0.5
            agent Car:
              param int numAgents = 2
              Drive:
                eff: stop
            agent Drone:
              param int numAgents = 1
              Fly:
                eff: stop
            """,
        ),
    )
}
