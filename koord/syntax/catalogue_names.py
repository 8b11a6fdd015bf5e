"""The stories of K201 to K213: names, and what may be written."""

from __future__ import annotations

from koord.syntax.catalogue_entry import Entry, error

ENTRIES: dict[str, Entry] = {
    entry.code: entry
    for entry in (
        error(
            "K201",
            "a name is not declared",
            """Every variable is declared under `local:`, `allread:` or `allwrite:`, every constant
            of a run by `param`, and every port by the module that a program is `using`. The name
            here is none of these, no loop's variable, no member of an enumeration.

            Usually it is misspelt. In a loop over the positions of a list, the element is
            `list[i]`: it has no name of its own.""",
            """
            local:
              int count = 0
            Count:
              eff: count = cuont + 1
            """,
            """
            local:
              int count = 0
            Count:
              eff: count = count + 1
            """,
        ),
        error(
            "K202",
            "there is no such function",
            """The name is called, but no `def fun` declares it, the library has none of that name,
            and it is no record that could be made. A function that some planner or platform
            supplies is declared with `extern` and a summary of what it keeps.""",
            """
            local:
              pos p = pos(0, 0, 0)
              float d = 0
            Measure:
              eff: d = distanse(p, p)
            """,
            """
            local:
              pos p = pos(0, 0, 0)
              float d = 0
            Measure:
              eff: d = distance(p, p)
            """,
        ),
        error(
            "K203",
            "there is no such type",
            """Types are `int`, `float`, `bool` (or `boolean`), `string`, `pos` (or `Point`), the
            records and enumerations of the program, arrays `T[]` and `T[k]`, and `List<T>`,
            `Queue<T>` and `Map<K, V>`. `Task` is predefined. Keys of a map are values that can be
            compared as a whole: no lists and no maps.""",
            """
            local:
              integer n = 0
            Count:
              eff: n = n + 1
            """,
            """
            local:
              int n = 0
            Count:
              eff: n = n + 1
            """,
        ),
        error(
            "K204",
            "a value has another type than its place wants",
            """Every expression has a type that is known before the program runs, and a value fits
            only where its type is wanted. There is one exception: an `int` is taken where a
            `float` is wanted. The other way round nothing is rounded silently, for the reader
            would not see in which direction.

            `int / int` is a whole number, rounded down; with a `float` on either side the division
            is exact.""",
            """
            local:
              int half = 0
            Halve:
              eff: half = pid / 2.0
            """,
            """
            local:
              float half = 0
            Halve:
              eff: half = pid / 2.0
            """,
        ),
        error(
            "K205",
            "there is no such field or member",
            """A name behind a dot is a field of a record, a member of an enumeration, or a port of
            a module. A `pos` has the fields `x`, `y` and `z`; the predefined `Task` has `loc`,
            `assigned`, `assignedTo` and `id`, which also go by `target`, `assignId` and `taskId`.
            Lists have elements instead: `tasks[i].loc`.""",
            """
            local:
              pos p = pos(0, 0, 0)
            Rise:
              eff: p.height = 2
            """,
            """
            local:
              pos p = pos(0, 0, 0)
            Rise:
              eff: p.z = 2
            """,
        ),
        error(
            "K206",
            "the module has no such port",
            """What stands behind the name of a module is one of its ports. A program may declare
            ports of its own under `sensors:` and `actuators:`, also for a module of the library,
            where they are added to those that it has.""",
            """
            using Motion
            Go:
              pre: Motion.readched
              eff: Motion.target = Motion.psn
            """,
            """
            using Motion
            Go:
              pre: Motion.reached
              eff: Motion.target = Motion.psn
            """,
        ),
        error(
            "K207",
            "a module is not in use",
            """A port can be named only if the program is `using` its module: that line says which
            devices a robot needs. In a program with several kinds of robot, each `agent` uses its
            own modules.""",
            """
            Go:
              eff: Motion.target = pos(0, 0, 0)
            """,
            """
            using Motion
            Go:
              eff: Motion.target = pos(0, 0, 0)
            """,
        ),
        error(
            "K208",
            "a name is declared twice",
            """Variables, params and members of enumerations share one space of names, so that a
            bare name has one meaning. Types, functions, events, modules and properties have their
            own: an event may be called like a variable. Sections of one sort may repeat, and are
            merged; what they declare may not.""",
            """
            local:
              int n = 0
            allwrite:
              bool n = false
            Count:
              eff: n = n + 1
            """,
            """
            local:
              int n = 0
            allwrite:
              bool full = false
            Count:
              eff: n = n + 1
                   full = true
            """,
        ),
        error(
            "K209",
            "the name belongs to the language",
            """`pid`, `numAgents` and `Nsys` mean the same everywhere, and the names of types are
            fixed. A variable of that name would hide them from the reader.""",
            """
            local:
              int pid = 3
            Count:
              eff: pid = pid + 1
            """,
            """
            local:
              int number = 3
            Count:
              eff: number = number + 1
            """,
        ),
        error(
            "K210",
            "a name has two meanings",
            """Two modules in use have a port of that name, or two enumerations a member. Say which
            one is meant by putting the module or the enumeration before it.""",
            """
            using Left:
              sensors:
                float range
            using Right:
              sensors:
                float range
            local:
              float near = 0
            Look:
              eff: near = range
            """,
            """
            using Left:
              sensors:
                float range
            using Right:
              sensors:
                float range
            local:
              float near = 0
            Look:
              eff: near = min(Left.range, Right.range)
            """,
        ),
        error(
            "K211",
            "an `allread` variable is no array over the robots",
            """Under `allread:` each robot has an entry that it alone writes and all others read.
            The variable is therefore an array with one element per robot, written `T[] x`, or
            `T x[numAgents]`. For one variable that all share, use `allwrite:`.""",
            """
            allread:
              int level
            Rise:
              eff: level[pid] = 1
            """,
            """
            allread:
              int[] level
            Rise:
              eff: level[pid] = 1
            """,
        ),
        error(
            "K212",
            "an `allread` variable is written elsewhere than at `[pid]`",
            """A robot writes its own entry, and the entry is written literally as `x[pid]`: then
            two robots never write one place, and no lock is needed. An index that merely happens
            to equal `pid` is refused, since nobody can see that it does.""",
            """
            allread:
              int[] level
            Rise:
              eff: level[pid + 1] = 1
            """,
            """
            allread:
              int[] level
            Rise:
              eff: level[pid] = 1
            """,
        ),
        error(
            "K213",
            "this cannot be written to",
            """Programs write variables, their parts, and actuators. Sensors are written by the
            environment, params by nobody during a run, loop variables by their loop, and the
            elements that `for x in list` goes through are copies.""",
            """
            allwrite:
              int[] marks = [1, 2, 3]
            Clear:
              eff:
                atomic:
                  for m in marks:
                    m = 0
            """,
            """
            allwrite:
              int[] marks = [1, 2, 3]
            Clear:
              eff:
                atomic:
                  for k = 0, length(marks):
                    marks[k] = 0
            """,
        ),
    )
}
