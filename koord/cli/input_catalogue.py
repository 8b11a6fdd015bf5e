"""The stories of the codes that no text of a program yields by itself: files that cannot be used,
traces, and runs that cannot be started. They have no examples in Koord.
"""

from __future__ import annotations

from koord.syntax.catalogue_entry import Entry
from koord.syntax.diagnostics import Severity


def _entry(
    code: str, title: str, story: str, severity: Severity = Severity.ERROR
) -> tuple[str, Entry]:
    return code, Entry(code, title, severity, story, bad="", good="")


INPUT_CATALOGUE = dict(
    [
        _entry(
            "K901",
            "a file cannot be read",
            "There is no such file, it is a folder, it may not be read, or it is too large to be "
            "a program (64 MiB). The message says which. What koord writes itself, as traces, is "
            "read from files of any size, and from pipes of that size.\n\n"
            "koord takes files, not folders: name them, as in `koord check specs/*.krd`. A single "
            "`-` is standard input.",
        ),
        _entry(
            "K902",
            "a file is not UTF-8",
            "Programs are UTF-8 text. The place is that of the first byte that is not: what "
            "stands before it was read.\n\n"
            "Either the file is no text, or an editor saved it in another encoding, such as "
            "UTF-16 or Latin-1; save it as UTF-8. A byte-order mark and Windows line ends are "
            "accepted.",
        ),
        _entry(
            "K903",
            "a file cannot be written",
            "The folder does not exist, the name is that of a folder, the disk is full, or the "
            "file may not be written.\n\n"
            "koord writes a new file beside the old one and then puts it in its place, so a file "
            "that could not be written is as it was before. Names given with --trace are tried "
            "before the work begins.",
        ),
        _entry(
            "K904",
            "a file holds properties only",
            "A file of invariants and assumptions is accepted by `koord check`, but there is "
            "nothing in it to run or verify. Name the program, and this file with `--with`: "
            "`koord verify app.krd --with props.krd`.",
        ),
        _entry(
            "K910",
            "a trace is not JSON",
            "A trace is one JSON document in UTF-8. This file is another kind of file, or it is "
            "cut off: the message says how far it could be read.\n\n"
            "koord writes traces whole or not at all. While a run goes on, its trace grows in a "
            "file beside it (`t.part.json`). That, and any trace that is cut off among its rounds, "
            "is read by `koord replay` up to the last whole round; this file has no rounds. Write "
            "it anew with `koord run --trace` or `koord verify --trace`.",
        ),
        _entry(
            "K911",
            "a JSON file is not a trace of koord",
            "The file is JSON, but it lacks the mark that koord gives its traces (the field "
            "`format`). Perhaps it is what `--json` printed, which is a verdict, not a trace.",
        ),
        _entry(
            "K912",
            "a trace is of another version",
            "The form of traces has a version of its own, which is raised whenever older programs "
            "could no longer read them. This trace is newer than this koord.",
        ),
        _entry(
            "K913",
            "a trace is damaged",
            "A field is missing, is there twice, or has another type than it should. The message "
            "begins with the place in the document: `$.rounds[3].order` is the field `order` of "
            "the fourth element of `rounds`.\n\n"
            "Traces are meant to be written by koord; if this one was edited, the place named is "
            "where to look.",
        ),
        _entry(
            "K914",
            "a trace does not fit its program",
            "The trace names an event, a variable, a function or a value that its program does not "
            "have. The trace was edited, or it is replayed with another program behind "
            "`--program`.",
        ),
        _entry(
            "K915",
            "the program in a trace was changed",
            "A trace holds the text of its program and a digest of it. They differ here, so what "
            "the trace says may be about another text. Undo the change, or name the program to be "
            "used with `--program`.",
        ),
        _entry(
            "K916",
            "the program in a trace has errors",
            "The program that the trace holds is no longer accepted: its errors follow. A newer "
            "koord may refuse what an older one let pass. Mend the program and name it with "
            "`--program`, or write the trace anew.",
        ),
        _entry(
            "K917",
            "an ITF document cannot be replayed",
            "ITF is a form of traces that several tools read and write. It holds the states, but "
            "not which robot ran what; koord writes that into the document too, and replays "
            "nothing without it.\n\n"
            "Either another tool wrote this document, or its states were edited and are no longer "
            "those that the recording leads to.",
        ),
        _entry(
            "K920",
            "no start of a run meets the assumptions",
            "A run begins in a configuration that meets every `assume:`. Variables without "
            "initial values were tried with many values, and none met this one.\n\n"
            "Either the assumptions contradict each other or the initial values, which `koord "
            "verify` tells, or the values are hard to find by trying: then give the variables "
            "initial values.",
        ),
        _entry(
            "K921",
            "no answer of an external function meets its summary",
            "A run has to invent what an external function answers, and nothing that was tried "
            "met the `ensures` of its summary.\n\n"
            "Either the summary is contradictory for these arguments, or an answer is hard to find "
            "by trying: then write the function in Koord, with a body.",
        ),
        _entry(
            "K922",
            "no reading of the sensors keeps the contracts",
            "A run has to invent what sensors read where a module has no `environment:` block, and "
            "nothing that was tried kept the `ensures` of its contracts.\n\n"
            "Either the contracts contradict each other, which `koord verify` tells, or a reading "
            "is hard to find by trying: then give the module an `environment:` block.",
        ),
        _entry(
            "K923",
            "an exact number has grown too long",
            "A run on exact numbers rounds nothing, so a value that is divided or multiplied in "
            "every round may grow by some digits each time, until a round takes minutes.\n\n"
            "Run for fewer rounds, or with `--numbers double`, which rounds as robots do.",
        ),
        _entry(
            "K924",
            "a list has grown too long",
            "What one variable holds may have 100,000 parts in lists, those of lists within lists "
            "counted too. A program that appends in every round reaches any length in time; one "
            "that appends to the list it goes through doubles it in every round.\n\n"
            "Run for fewer rounds, or take out of lists what is no more needed.",
        ),
        _entry(
            "K925",
            "a number is larger than any double",
            "Robots calculate with doubles, which end at about 1.8e308, and a number of the "
            "program, or the value that a param is set to, lies beyond. The verifier calculates "
            "exactly and has no such end: `koord verify` and `koord run` take the program.\n\n"
            "Take another unit, so that numbers become smaller, or another value of the param.",
        ),
        _entry(
            "K930",
            "a configuration file is not YAML",
            "The configuration of a run is a YAML file of named fields: robots, devices, how they "
            "talk, the world. The place is where reading it had to stop.\n\n"
            "Mostly a bracket or a quote is not closed, a line is indented by a tab, or a colon "
            "lacks the space behind it.",
        ),
        _entry(
            "K931",
            "a configuration does not make sense",
            "A field is unknown, is there twice, has another type than it should, or contradicts "
            "another: two robots with one pid, a device that is not described, an address that is "
            "none.\n\n"
            "`koord schema` prints the JSON Schema of these files, with which most editors tell "
            "such mistakes while one writes.",
        ),
        _entry(
            "K932",
            "a program cannot be deployed with this configuration",
            "The program and the configuration are each in order, and do not go together: a robot "
            "is of no kind that the program has, the key that robots share is missing, or the "
            "program asks for something that robots without a platform cannot do.",
        ),
        _entry(
            "K933",
            "the network cannot be used",
            "An address cannot be listened on or sent to: another program has the port, it is no "
            "address of this machine, or the network card has no multicast.\n\n"
            "The message names the address. `network: {transport: unicast}` needs the least of a "
            "network.",
        ),
        _entry(
            "K934",
            "a simulated run does not begin as the program assumes",
            "The program says with `assume` how its runs begin, and whoever verifies it takes that "
            "for granted. Here robots, or what they share, begin otherwise: mostly because the "
            "configuration leaves open where robots are, and then the seed says.\n\n"
            "The message names the assumption and the robots. `position` of a robot, `positions` "
            "and `world: {start: …}` say where they begin.",
        ),
        _entry(
            "K935",
            "there is no cluster at this address",
            "`koord sim --runs K --cluster ADDRESS` hands its runs to the scheduler of a Dask "
            "cluster, and at this address none answers.\n\n"
            "`dask scheduler` starts one and tells its address; `dask worker ADDRESS --nthreads 1` "
            "adds a worker, which needs koord installed as well.",
        ),
        _entry(
            "K936",
            "a configuration is of another instance than the program is meant for",
            "A program may state how many robots it is meant for, and how long its rounds are "
            "(`param int numAgents = 9`, `param float delta = 40`). The configuration says "
            "otherwise, and it is what counts: but what was verified without flags was the "
            "instance that the program states.\n\n"
            "Verify what is run, with `--robots` and `--delta`, or let the two say the same.",
            Severity.WARNING,
        ),
        _entry(
            "K937",
            "the file has other runs than are to be kept in it",
            "`koord sim --runs K --csv FILE` writes a line as each run ends, so that a campaign "
            "which was ended can go on: `--resume` does, with the runs that are missing. That "
            "needs a file of the same campaign: the same program, configuration, first seed and "
            "flags, by the same version of koord (the number of runs and the values of a sweep "
            "may be others). Without `--resume` a file that has a part of the campaign is not "
            "written over.",
        ),
        _entry(
            "K940",
            "a file is not a certificate of koord",
            "A certificate is one JSON document, written by `koord verify --certificate`. This "
            "file is another kind of document, it is cut off, or a part of it is missing or of "
            "another type than it should be; the message names the part. "
            "`koord schema certificate` prints the format, as a JSON Schema.",
        ),
        _entry(
            "K941",
            "a certificate is refused",
            "The file has the form of a certificate, and contradicts itself or the program: its "
            "text is not the one that was certified, it claims what the program does not state, "
            "an obligation is missing, a script in it is no question in SMT-LIB 2, or it does not "
            "say what the proof rests on.\n\n"
            "Nothing is said then of the claims: write the certificate anew with "
            "`koord verify --certificate`.",
        ),
        _entry(
            "K942",
            "there is no second solver",
            "`koord recheck` settles obligations with cvc5, which is not the solver that "
            "`koord verify` uses. It is not installed with koord unless one asks for it: "
            "`pip install 'koord[recheck]'`.",
        ),
        _entry(
            "K943",
            "a program cannot be written in TLA+",
            "`koord verify --export tla` writes programs whose data are Booleans, integers, "
            "enumerations, records and arrays, and whose robots have no vehicle: modules and "
            "external functions are not translated, nor are floats, strings, and lists that grow. "
            "Starts may be left open: unset, any Boolean or member of an enumeration, or an "
            "integer that INIT chooses between two constants.\n\n"
            "The place is where the first such thing stands; the hint names the exports that take "
            "the program as it is. `--export smt2` takes nearly all: it has integers and reals.",
        ),
        _entry(
            "K944",
            "a program cannot be written as a problem for solvers",
            "`koord verify --export aiger` and `vmt` write a program as a circuit, `smt2` as a "
            "question with integers and reals where a circuit would leave values open. This "
            "program has something that none of them can say, such as a map in a question about "
            "every value of a type; the message names it. The hint names the exports that take the "
            "program as it is, if there are any.",
        ),
        _entry(
            "K950",
            "a library is not installed",
            "Vehicles, planners and controllers rest on libraries that koord does not install "
            "unless one asks for them, because verifying programs needs none.\n\n"
            "The message names the library and the hint the extra that has it: "
            "`pip install 'koord[sim]'` for the simulator and for motion on robots, "
            "`pip install 'koord[fast]'` for compiled vehicle models.",
        ),
    ]
)
