"""Certificates: proofs for all rounds, in a form that others can check.

The claims and the invariant are Koord; the obligations are SMT-LIB 2, as the encoding here has
them. ``koord recheck`` makes obligations of its own: it does not rely on these
(``specs/certificates/README.md``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from fractions import Fraction

from msgspec import Struct, field, to_builtins
from msgspec.structs import replace

from koord.semantics.domain import disjunction
from koord.syntax import ast, core
from koord.syntax.core import PropertyKind
from koord.syntax.elaboration.settings import Settings
from koord.syntax.forms import NotCovered, Text
from koord.syntax.literals import encoded
from koord.syntax.load import load
from koord.syntax.parsing.parser import parse
from koord.syntax.printing.program import stated
from koord.syntax.printing.quoting import Quoting
from koord.syntax.source import Source
from koord.syntax.system import System
from koord.syntax.walk import nodes
from koord.verify import certificate_form as forms
from koord.verify.certified_progress import find_progress, written
from koord.verify.claims import Claim, ClaimKind, ClaimPhase, claims_of, liveness_of
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.unrolling import Unrolling, violations
from koord.verify.engine_names import Engine
from koord.verify.engines.every_n.candidates import candidates
from koord.verify.engines.every_n.lemma_search import infer_from_counterexamples
from koord.verify.engines.every_n.proving import infer
from koord.verify.engines.every_n.questions import GENEROUS
from koord.verify.engines.induction.engine import MAX_DEPTH, PROOF_S
from koord.verify.engines.induction.proving import prove, step_scripts
from koord.verify.reduction.abstraction import abstracted
from koord.verify.verdicts import Outcome, Report

#: What the configurations are called that a step looks at.
_MOMENTS = {
    ClaimPhase.INIT: "initiation",
    ClaimPhase.INSIDE: "consecution inside a round",
    ClaimPhase.MIDDLE: "consecution of the program turns",
    ClaimPhase.END: "consecution of the environment's turn",
}


class Texts(Struct, frozen=True):
    """The texts that a program was read from, and its settings."""

    program: Source
    properties: tuple[Source, ...]
    settings: Settings


class Lemma(Struct, frozen=True):
    """An invariant that was found; ``everyone``: for every number of robots."""

    stated: core.Property
    everyone: bool

    @property
    def is_open(self) -> bool:
        """True if it speaks of all integers of a range that is not known beforehand."""
        ranges = (node for node in nodes(self.stated.condition) if isinstance(node, core.IntRange))
        ends = (end for each in ranges for end in nodes((each.low, each.high)))
        return any(isinstance(end, core.Read) for end in ends)


class ProvedClaims(Struct, frozen=True):
    """Names of the claims that hold in all rounds, by whichever engine, with lemmas that show it.

    ``everyone`` are those of them that hold for every number of robots. ``beyond`` are claims that
    hold and that no certificate is about, each with the reason. ``of_runs`` are claims about whole
    runs that hold, of which a proof of progress is looked for.
    """

    holding: tuple[str, ...]
    everyone: frozenset[str] = frozenset()
    lemmas: tuple[Lemma, ...] = ()
    beyond: Mapping[str, str] = field(default_factory=dict)
    unsaid: Mapping[str, str] = field(default_factory=dict)
    of_runs: tuple[str, ...] = ()


#: Why a claim is not certified that is about whole runs.
_OF_RUNS = "it is about whole runs, and no proof of progress of every number of robots was found"


def shown_by(report: Report) -> ProvedClaims:
    """The claims that a verification has shown for all rounds, with lemmas."""
    settled = [v for v in report.verdicts if v.outcome is Outcome.HOLDS and v.rounds is None]
    holding = [v for v in settled if v.claim.kind is not ClaimKind.LIVENESS]
    lemmas = (Lemma(stated, v.engine is Engine.EVERY_N) for v in holding for stated in v.lemmas)
    return ProvedClaims(
        tuple(v.claim.name for v in holding),
        frozenset(v.claim.name for v in holding if v.engine is Engine.EVERY_N),
        tuple(dict.fromkeys(lemmas)),
        unsaid={
            v.claim.name: f"its invariant is not said in Koord: {v.unsaid}"
            for v in holding
            if v.unsaid
        },
        of_runs=tuple(v.claim.name for v in settled if v.claim.kind is ClaimKind.LIVENESS),
    )


class Certificate(Struct, frozen=True):
    """A certificate as JSON, and the reasons why claims that hold are missing from it."""

    document: dict[str, object]
    not_covered: Mapping[str, str]


def certificate(
    system: System, texts: Texts, shown: ProvedClaims, deadline: Deadline, version: str
) -> Certificate | None:
    """Make the certificate of those claims that are inductive together; None if there are none."""
    shown, proofs = _with_progress(system, shown, deadline)
    system, subject, found, depths = _argument(system, texts, shown, deadline)
    if set(shown.holding) - {claim.name for claim in depths}:
        helped = _with_lemmas(system, shown, depths, deadline)
        if helped is not None:
            shown = helped
            system, subject, found, depths = _argument(system, texts, shown, deadline)
    if not depths:
        return None
    names = frozenset(name for name, _ in found)
    helping = {name for (name, _), lemma in zip(found, shown.lemmas, strict=True) if lemma.everyone}
    originals = dict(zip(claims_of(subject), claims_of(system), strict=True))
    depth_of = {originals[claim].name: depth for claim, depth in depths.items()}
    # A proof for every number stands or falls as a whole.
    together = helping | shown.everyone
    pairs = zip(found, shown.lemmas, strict=True)
    # Those that no number of robots makes finite are shown for every number alone.
    open_ = {name: 1 for (name, _), lemma in pairs if lemma.is_open}
    is_whole = together <= (depth_of | open_).keys()
    depth_of |= open_ if is_whole else {}
    everyone = together if is_whole else frozenset[str]()
    claimed = [originals[claim] for claim in depths if originals[claim].name not in names]
    # A proof about whole runs rests on what is shown for every number of robots.
    runs = proofs if is_whole else {}
    beyond = {name: _OF_RUNS for name in shown.of_runs if name not in {c.name for c in runs}}
    not_covered = (
        dict(shown.beyond)
        | beyond
        | {
            name: shown.unsaid.get(name, "it is not shown by induction over the rounds")
            for name in shown.holding
            if name not in depth_of
        }
    )
    settings = texts.settings
    form = forms.CertificateForm(
        format=forms.FORMAT,
        version=forms.VERSION,
        made_by=f"koord {version}",
        program=_text(texts.program),
        properties=[_text(source) for source in texts.properties],
        parameters={name: encoded(v) for name, v in settings.params.items()},
        tasks=None if settings.tasks is None else [_exact(place) for place in settings.tasks],
        kinds=list(system.kinds),
        delta=str(system.delta_s),
        claims=[
            *(forms.Claim(c.name, c.kind.value, c.subject, c.name in everyone) for c in claimed),
            *(forms.Claim(c.name, c.kind.value, c.subject, True) for c in runs),
        ],
        invariant=list(_invariant(system.program, texts, found, depth_of, everyone)),
        progress=list(runs.values()),
        rests_on=rests_on(system.program),
        not_covered=[NotCovered(name, why) for name, why in not_covered.items()],
        obligations=[
            forms.Obligation(name, text, digest(text))
            for name, text in _obligations(subject, depths)
        ],
    )
    document: dict[str, object] = to_builtins(form)
    return Certificate(document, not_covered)


def _with_progress(
    system: System, shown: ProvedClaims, deadline: Deadline
) -> tuple[ProvedClaims, dict[Claim, forms.Progress]]:
    """Look for proofs of claims about whole runs, and add the invariants that they rest on."""
    proofs: dict[Claim, forms.Progress] = {}
    for subject in _subjects(system):
        left = set(shown.of_runs) - {claim.name for claim in proofs}
        of_runs = [claim for claim in liveness_of(subject) if claim.name in left]
        if not of_runs:
            break
        holding = [claim for claim in claims_of(subject) if claim.name in shown.holding]
        known = [c for c in holding if c.name in shown.everyone and c.is_state_property]
        known += [
            Claim(f"found {k}", ClaimKind.PROPERTY, lemma.stated)
            for k, lemma in enumerate(shown.lemmas)
            if lemma.everyone
        ]
        found = find_progress(subject, of_runs, holding, known, deadline)
        more = [Lemma(stated, True) for stated in found.lemmas]
        shown = replace(
            shown,
            everyone=shown.everyone | {claim.name for claim in found.everyone},
            lemmas=tuple(dict.fromkeys([*shown.lemmas, *more])),
        )
        for claim, proof in found.proofs.items():
            proofs[claim] = written(subject.program, claim, proof)
    return shown, proofs


def _argument(
    system: System, texts: Texts, shown: ProvedClaims, deadline: Deadline
) -> tuple[System, System, list[tuple[str, Source]], dict[Claim, int]]:
    """The system with its lemmas, the claims of the proof, and the depth of the induction."""
    found = _found(system.program, shown.lemmas) if shown.lemmas else []
    if found:
        system = replace(system, program=_with_found(texts, found))
    listed = {name for (name, _), x in zip(found, shown.lemmas, strict=True) if not x.is_open}
    subject, depths = _inductive(system, {*shown.holding, *listed}, deadline)
    return system, subject, found, depths


def _with_lemmas(
    system: System, shown: ProvedClaims, inductive: Mapping[Claim, int], deadline: Deadline
) -> ProvedClaims | None:
    """Add invariants that make more claims inductive, if some are found.

    A search needs none to settle a claim, and a certificate does.
    """
    claims = {claim.name: claim for claim in claims_of(system)}
    known = [claims[name] for name in sorted(shown.everyone) if claims[name].is_state_property]
    done = {claim.name for claim in inductive}
    left = [claims[name] for name in shown.holding if name not in done]
    if deadline.passed():
        return None
    effort = Effort.of_seconds(GENEROUS.seconds)
    found = infer_from_counterexamples(system, left, known, deadline, effort, GENEROUS)
    if not found.proved:
        likely = candidates(system.program)
        if not likely or deadline.passed():
            return None
        effort = Effort.of_seconds(GENEROUS.seconds)
        found = infer(system, left, [*known, *likely], deadline, effort, GENEROUS)
    if not found.proved:
        return None
    lemmas = [Lemma(stated, True) for stated in found.lemmas(known)]
    return replace(
        shown,
        everyone=shown.everyone | {claim.name for claim in found.proved},
        lemmas=tuple(dict.fromkeys([*shown.lemmas, *lemmas])),
    )


def _found(program: core.Program, lemmas: Sequence[Lemma]) -> list[tuple[str, Source]]:
    """Turn lemmas, each with a name, into texts: what is proved is what these say."""
    quoting = Quoting.of(program)
    named = [(f"Found{k}", lemma.stated) for k, lemma in enumerate(lemmas, start=1)]
    return [(n, Source(f"found: {n}", f"{quoting.invariant(x, n)}\n")) for n, x in named]


def _with_found(texts: Texts, found: Sequence[tuple[str, Source]]) -> core.Program:
    sources = (*texts.properties, *(source for _, source in found))
    program = load(texts.program, texts.settings, sources).program
    assert program is not None, "what is found is Koord"
    return program


def _text(source: Source) -> Text:
    return Text(source.name, source.text, digest(source.text))


def _exact(place: tuple[Fraction, Fraction, Fraction]) -> tuple[str, str, str]:
    x, y, z = map(str, place)
    return x, y, z


def digest(text: str) -> str:
    """The SHA-256 of a text in UTF-8, in hexadecimal."""
    from hashlib import sha256

    return sha256(text.encode("utf-8", errors="surrogatepass")).hexdigest()


# --- the claims -----------------------------------------------------------------------------------


def _inductive(
    system: System, names: Set[str], deadline: Deadline
) -> tuple[System, dict[Claim, int]]:
    """The claims that induction alone shows, each with the number of rounds it takes."""
    best: tuple[System, dict[Claim, int]] = (system, {})
    for subject in _subjects(system):
        claims = [claim for claim in claims_of(subject) if claim.name in names]
        found: dict[Claim, int] = {}
        effort = Effort.of_seconds(PROOF_S)
        for depth in range(1, MAX_DEPTH + 1):
            left = [claim for claim in claims if claim not in found]
            if not left or deadline.passed():
                break
            # Lists and maps of any length are for the recheck: here it is enough that the claims
            # hold, and that nothing speaks against the argument.
            proved = prove(
                subject, left, list(found), deadline, effort, depth=depth, within_limits=True
            ).proved
            found |= dict.fromkeys(proved, depth)
        if len(found) > len(best[1]):
            best = (subject, {claim: found[claim] for claim in claims if claim in found})
        if len(found) == len(names):
            break
    return best


def _subjects(system: System) -> Iterator[System]:
    abstraction = abstracted(system.program)
    if abstraction is not None:
        yield replace(system, program=abstraction.program)
    yield system


def _invariant(
    program: core.Program,
    texts: Texts,
    found: Sequence[tuple[str, Source]],
    depth_of: Mapping[str, int],
    everyone: Set[str],
) -> Iterator[forms.Conjunct]:
    """The conjuncts of the invariant as texts: from the program, its property files, or lemmas."""
    kinds = (PropertyKind.INVARIANT, PropertyKind.AT_ROUND)
    names = [p.name for p in program.properties if p.kind in kinds]
    sections = [
        section
        for source in (texts.program, *texts.properties, *(source for _, source in found))
        for section in parse(source).program.sections
    ]
    for name, text in zip(names, stated(sections, ast.Invariant), strict=True):
        if name in depth_of:
            yield forms.Conjunct(name, depth_of[name], name in everyone, text.text)


def rests_on(program: core.Program) -> forms.RestsOn:
    """The names of the assumptions, contracts and summaries that a proof may have used."""
    modules = (m for agent in program.agents for m in agent.modules if m.environment is None)
    return forms.RestsOn(
        assumptions=[assumption.name for assumption in program.assumptions],
        contracts=[contract.name for module in modules for contract in module.contracts],
        summaries=[e.name for e in program.externals if e.requires or e.ensures],
    )


# --- the obligations ------------------------------------------------------------------------------


def _obligations(system: System, depths: Mapping[Claim, int]) -> Iterator[tuple[str, str]]:
    """The proof obligations: names and SMT-LIB scripts, each to be unsatisfiable."""
    for depth in sorted(set(depths.values())):
        assumed = [claim for claim, d in depths.items() if d <= depth]
        asked = [claim for claim, d in depths.items() if d == depth]
        over = "" if depth == 1 else f", over {depth} rounds"
        yield from _base(system, asked, depth, over)
        for phase, script in step_scripts(system, assumed, asked, depth):
            yield f"{_MOMENTS[phase]}{over}", script


def _base(
    system: System, asked: Sequence[Claim], depth: int, over: str
) -> Iterator[tuple[str, str]]:
    """The base case: INIT, and the rounds before the first one that the step is about."""
    unrolling = Unrolling(system)
    d, solver, number = unrolling.encoder.d, unrolling.solver, 0
    for moment in unrolling.moments():
        found = list(violations(system, d, moment, asked).values())
        for _, needed in found:
            solver.add(needed)
        where = f" in round {number + 1}" if moment.phase is not ClaimPhase.INIT else ""
        name = _MOMENTS[moment.phase].replace("consecution", "base") + where
        script = solver.script([disjunction(d, [violated for violated, _ in found])])
        yield f"{name}{over}", script
        if moment.phase in (ClaimPhase.INIT, ClaimPhase.END):
            number += moment.phase is ClaimPhase.END
            if number + 1 == depth:
                return
