"""Mistakes in what kept verdicts depend on, and in how they are kept."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

FORMS = "tests/verify/cache/test_forms.py"
KEPT = "tests/verify/cache/test_kept.py"
FOLDER = "tests/verify/cache/test_folder.py"
REACHING = "tests/verify/vacuity/test_reaching_runs.py"

CACHED = (
    Mutant(
        "cache: verdicts do not depend on guards",
        "verify.cache.forms._Writer.agent",
        "self.write((event.guard, event.effect), kind)",
        "self.write((event.effect,), kind)",
        (FORMS, KEPT),
    ),
    Mutant(
        "cache: verdicts do not depend on assumptions",
        "verify.cache.forms.Form",
        "writer.write((assumption.condition, assumption.bound), None)",
        "pass",
        (FORMS, KEPT),
    ),
    Mutant(
        "cache: verdicts do not depend on what is expected",
        "verify.cache.forms.Form",
        "writer.write(program.expectations, None)",
        "pass",
        (FORMS, KEPT),
    ),
    Mutant(
        "cache: verdicts do not depend on summaries",
        "verify.cache.forms.Form",
        "writer.write((program.functions, program.externals), None)",
        "writer.write((program.functions,), None)",
        (FORMS, KEPT),
    ),
    Mutant(
        "cache: verdicts do not depend on how long a round is",
        "verify.cache.forms.Form",
        "(program.tasks, system.kinds, system.delta_s, repr(system.crowd))",
        "(program.tasks, system.kinds, repr(system.crowd))",
        (FORMS,),
    ),
    Mutant(
        "cache: verdicts do not depend on what locks are about",
        "verify.cache.forms.Form",
        "writer.write(each.variables, None)",
        "pass",
        (FORMS,),
    ),
    Mutant(
        "cache: calls are not told apart",
        "verify.cache.forms._Writer._struct",
        "self._sites.setdefault(part, len(self._sites))",
        "0",
        (FORMS,),
    ),
    Mutant(
        "cache: which event ran plays no part",
        "verify.cache.forms._Writer._struct",
        "numbers.get((k, n), _OUTSIDE)",
        "_OUTSIDE",
        (FORMS,),
    ),
    Mutant(
        "cache: verdicts of other versions count",
        "verify.cache.dependence.Question",
        'f"rounds {self.rounds}; engine {engine}; seed {self.seed}; version {self.version}"',
        'f"rounds {self.rounds}; engine {engine}; seed {self.seed}"',
        (KEPT,),
    ),
    Mutant(
        "cache: verdicts of fewer rounds count",
        "verify.cache.dependence.Question",
        'f"rounds {self.rounds}; engine {engine}; seed {self.seed}; version {self.version}"',
        'f"engine {engine}; seed {self.seed}; version {self.version}"',
        (KEPT,),
    ),
    Mutant(
        "cache: a claim is looked for by its name alone",
        "verify.cache.forms._Writer._struct",
        "self.write(part, kind)",
        "self.write(type(part).__name__, kind)",
        (FORMS, KEPT),
    ),
    Mutant(
        "cache: what helped a proof plays no part",
        "verify.cache.kept.VerdictCache.keep",
        "[each.names for each in known if each.verdict.outcome is Outcome.HOLDS]",
        "[]",
        (KEPT,),
    ),
    Mutant(
        "cache: only the slice counts where more was asked",
        "verify.cache.kept.VerdictCache.keep",
        "not report.of_slice or bool(report.failures) or bounds.claim_s is not None",
        "False",
        (KEPT,),
    ),
    Mutant(
        "cache: a report does not say that more than a slice was asked",
        "verify.strategy.verification._Verification.report",
        "last is ledger and not known",
        "True",
        (KEPT,),
    ),
    Mutant(
        "cache: runs are shown as they were kept",
        "verify.cache.kept.VerdictCache._revived",
        "replace(verdict, counterexample=shown)",
        "verdict",
        (KEPT,),
    ),
    Mutant(
        "cache: slots of other programs count",
        "verify.cache.kept.VerdictCache._known",
        "layout is not None and dependences.layout(names) != layout",
        "False",
        (KEPT,),
    ),
    Mutant(
        "cache: what was looked at in too little time is kept",
        "verify.cache.kept._is_fact",
        "verdict.rounds is None or lasting",
        "True",
        (KEPT,),
    ),
    Mutant(
        "cache: checksums are not compared",
        "verify.cache.folder._checked",
        "magic != _MAGIC or checksum != _checksum(data, key)",
        "magic != _MAGIC",
        (FOLDER,),
    ),
    Mutant(
        "cache: a checksum is of the data alone",
        "verify.cache.folder._checksum",
        'key.encode("ascii") + data',
        "data",
        (FOLDER,),
    ),
    Mutant(
        "cache: links are followed",
        "verify.cache.folder._read",
        'os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)',
        "os.O_RDONLY",
        (FOLDER,),
    ),
    Mutant(
        "cache: a run that reached a goal of another program reaches it",
        "verify.vacuity.reaching_runs._broken_by",
        "violated is True and all(needed.condition is True for needed in legality)",
        "True",
        (REACHING,),
    ),
    Mutant(
        "cache: runs of other types are replayed",
        "verify.vacuity.reaching_runs.ReachingRuns.replayed",
        "run.layout != layout or not (pending or not goes_on)",
        "not (pending or not goes_on)",
        (REACHING,),
    ),
    Mutant(
        "cache: answers of kept runs may be those of no function",
        "verify.vacuity.reaching_runs._shown",
        "unkept(system, heard) is not None",
        "False",
        (REACHING,),
    ),
    Mutant(
        "cache: what is reached later than anybody looks counts",
        "verify.vacuity.reaching_runs._shown",
        "step.configuration.fault is not None or step.configuration.round > rounds",
        "step.configuration.fault is not None",
        (REACHING,),
    ),
    Mutant(
        "cache: a kept run starts whatever is assumed",
        "verify.vacuity.analysis._look",
        "shown.starts",
        "reaching.before",
        (REACHING,),
    ),
    Mutant(
        "cache: what one kept run reaches stands for all goals",
        "verify.vacuity.analysis._look",
        "nevers or not shown.goes_on",
        "not shown.goes_on",
        (REACHING,),
    ),
)
