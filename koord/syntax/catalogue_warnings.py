"""The stories of K4xx: warnings."""

from __future__ import annotations

from koord.syntax.catalogue_entry import Entry, warning

ENTRIES: dict[str, Entry] = {
    entry.code: entry
    for entry in (
        warning(
            "K401",
            "an update may be lost",
            """An event reads an `allwrite` variable, in its guard or its effect, and writes it
            outside of `atomic`. Reads are of the state at the start of the round: if two robots run
            the event in one round, both read the old value, and the later write wins. Under
            `atomic:` at most one robot a round runs the event. A write of a part of a map's entry,
            as `m[k].f = v`, writes the whole entry, and so reads the rest of it.

            It is no error. An algorithm that lets robots race for a variable looks later who won,
            in another event (as Fischer's does): of that nothing is said.""",
            """
            allwrite:
              int sum = 0
            Add:
              eff: sum = sum + pid
            """,
            """
            allwrite:
              int sum = 0
            Add:
              eff: atomic: sum = sum + pid
            """,
        ),
        warning(
            "K402",
            "an event is never enabled",
            """The guard is false whatever the values of the variables, so that the event never
            runs: it is false as such, or its parts leave no value to something. Perhaps a param has
            a value that nobody thought of. Events that never run for a deeper reason are found
            by `koord verify`.""",
            """
            param int limit = 0
            local:
              int n = 0
            Count:
              pre: limit > 0 and n < limit
              eff: n = n + 1
            """,
            """
            param int limit = 5
            local:
              int n = 0
            Count:
              pre: limit > 0 and n < limit
              eff: n = n + 1
            """,
        ),
        warning(
            "K403",
            "a variable is never used",
            """Nothing in the program, its properties or its module's contracts names the variable.
            The variable of a `for` loop is declared by the loop: one of that name under `local:` is
            another one.""",
            """
            local:
              int i
              int sum = 0
            Add:
              eff: for i = 0, 3: sum = sum + i
            """,
            """
            local:
              int sum = 0
            Add:
              eff: for i = 0, 3: sum = sum + i
            """,
        ),
        warning(
            "K404",
            "an assumption or a contract contradicts itself",
            """What is required can never hold, so that what follows from it means nothing: with an
            assumption that is false no run begins, and every property holds of none. Told is what
            is false as such, and statements that leave no value to something (`n == 0` and
            `n > 3`); deeper contradictions are found by `koord verify`.""",
            """
            param int tasks = 0
            assume: tasks > 0
            Go:
              eff: stop
            """,
            """
            param int tasks = 4
            assume: tasks > 0
            Go:
              eff: stop
            """,
        ),
        warning(
            "K405",
            "the program is empty",
            """There is nothing in the file, or only comments. It is accepted: robots that run it do
            nothing.""",
            """
            # to do
            """,
            """
            Wait:
              eff: pass
            """,
        ),
        warning(
            "K406",
            "a variable is read and never set",
            """A variable without an initial value is unset; to read it is a fault. Nothing in the
            program sets this one: no `init:`, no event. To append to a list, or to change one of
            its elements, reads it first. Of records and arrays each field counts by itself.""",
            """
            local:
              Queue<int> waiting
            Join:
              eff: waiting.append(pid)
            """,
            """
            local:
              Queue<int> waiting = []
            Join:
              eff: waiting.append(pid)
            """,
        ),
    )
}
