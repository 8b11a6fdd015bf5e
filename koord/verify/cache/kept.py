"""Verdicts that are kept: of a program, and shown again for one that differs in nothing of it.

Kept is what is a fact: that a claim holds, with the invariants that were found for it, or a run
that breaks it, which is replayed anew before it counts. What is *unknown* is asked again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.rounds import IllegalStepError
from koord.stores.folder import FileForm
from koord.stores.store import Store
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.verify.cache.codec import CodecError, plain, revived
from koord.verify.cache.dependence import Dependences, Names
from koord.verify.cache.forms import Form, digest
from koord.verify.claims import NO_FAULT, Claim, ClaimKind
from koord.verify.engine_names import Engine
from koord.verify.verdicts import (
    Bounds,
    Counterexample,
    Outcome,
    ReachingRun,
    Report,
    Substance,
    Vacuity,
    Verdict,
)

#: How verdicts are kept in a folder.
VERDICT_FILES = FileForm("verdict", b"koord-verdict-2", "json", 64 * 2**20, 4 * 2**20)

#: So many verdicts are kept on claims that are written alike, of different programs: who goes back
#: to what the text was before finds what was known of it.
MOST_ALIKE = 8

#: So many runs are kept of programs of one name that reach what should be possible.
MOST_RUNS = 8


class KeptVacuities(Struct, frozen=True):
    """All vacuities of some verdicts; perhaps none."""

    vacuities: tuple[Vacuity, ...]


class Known(Struct, frozen=True):
    """A kept verdict, and the names of the parts that it depends on."""

    verdict: Verdict
    names: Names


class VerdictCache(Struct, frozen=True):
    """A cache of verdicts in some store.

    ``note`` is told of entries that are damaged, which are removed.
    """

    store: Store
    note: Callable[[str], None] = lambda text: None

    def known(self, dependences: Dependences) -> dict[Claim, Known]:
        """The kept verdicts on the claims about a system."""
        found = {claim: self._known(dependences, claim) for claim in dependences.claims}
        return {claim: known for claim, known in found.items() if known is not None}

    def likely(self, dependences: Dependences, known: Collection[Claim]) -> tuple[Verdict, ...]:
        """What was found last of other programs, and held, on claims that are not ``known`` here.

        It says nothing of this program but who may be asked first.
        """
        found = []
        for claim in dependences.claims:
            entries = [] if claim in known else _entries(self._read(dependences.asked(claim)) or {})
            try:
                verdict = revived(entries[0]["verdict"]) if entries else None
            except (CodecError, KeyError):
                continue
            if isinstance(verdict, Verdict) and verdict.outcome is Outcome.HOLDS:
                found.append(replace(verdict, claim=claim))
        return tuple(found)

    def keep(
        self,
        dependences: Dependences,
        report: Report,
        bounds: Bounds,
        known: Iterable[Known] = (),
    ) -> None:
        """Keep what is new in a report. What was ``known`` may have helped to find it."""
        lemmas = [each.names for each in known if each.verdict.outcome is Outcome.HOLDS]
        # Where a process died, or claims were asked one by one, nobody knows what was looked at.
        whole = not report.of_slice or bool(report.failures) or bounds.claim_s is not None
        lasting = not report.interrupted and bounds.timeout_s is None and bounds.claim_s is None
        for verdict in report.verdicts:
            if not verdict.kept and _is_fact(verdict, lasting=lasting):
                self._keep(dependences, verdict, lemmas, whole=whole)

    def vacuities(
        self, dependences: Dependences, verdicts: Sequence[Verdict], names: Collection[str]
    ) -> KeptVacuities | None:
        """The kept vacuities of verdicts on the claims that are asked about by their names."""
        key, places = _of_vacuities(dependences, verdicts, names)
        data = self._read(key)
        if data is None:
            return None
        try:
            found = []
            for each, place in data["vacuities"]:
                span = None if place is None else places[place]
                found.append(replace(revived(each), span=span))
            return KeptVacuities(tuple(found))
        except (CodecError, TypeError, LookupError, ValueError):
            self._damaged(key)
            return None

    def keep_vacuities(
        self, dependences: Dependences, report: Report, names: Collection[str]
    ) -> None:
        """Keep the vacuities of a report, if all were looked for to the end."""
        if report.interrupted or report.failures or report.unlooked:
            return
        key, places = _of_vacuities(dependences, report.verdicts, names)
        data = []
        for vacuity in report.vacuities:
            if vacuity.span is not None and vacuity.span not in places:
                return
            place = None if vacuity.span is None else places.index(vacuity.span)
            data.append([plain(vacuity), place])
        self._write(key, {"vacuities": data})

    def substance(self, dependences: Dependences, verdicts: Sequence[Verdict]) -> Substance:
        """What some verdicts on all claims are known to be about, if the others are like them."""
        kinds = _kinds_of(verdicts)
        form = dependences.happening()
        said = [_of_verdict(dependences, form, verdict, kinds) for verdict in verdicts]
        return replace(
            kinds,
            happens=self._read(_of_happening(dependences, form, kinds)) is not None,
            claims=frozenset(
                verdict.claim.name
                for verdict, key in zip(verdicts, said, strict=True)
                if verdict.outcome is Outcome.HOLDS and self._read(key) is not None
            ),
        )

    def keep_substance(self, dependences: Dependences, report: Report) -> None:
        """Keep what a report on all claims is seen to be about."""
        found = report.substance
        if found is None:
            return
        form, kinds = dependences.happening(), replace(found, happens=False, claims=frozenset())
        if found.happens:
            self._write(_of_happening(dependences, form, kinds), {})
        for verdict in report.verdicts:
            if verdict.claim.name in found.claims:
                self._write(_of_verdict(dependences, form, verdict, kinds), {})

    def reaching(self, dependences: Dependences) -> tuple[ReachingRun, ...]:
        """The kept runs that reached what should be possible; a replay has to show it again."""
        key = dependences.lineage
        try:
            found = [revived(each) for each in (self._read(key) or {}).get("runs", ())]
        except (CodecError, TypeError):
            self._damaged(key)
            return ()
        return tuple(each for each in found if isinstance(each, ReachingRun))

    def keep_reaching(self, dependences: Dependences, report: Report) -> None:
        """Keep the runs of a report that reach what should be possible, before older ones."""
        if not report.reaching:
            return
        runs = dict.fromkeys((*report.reaching, *self.reaching(dependences)))
        try:
            data = [plain(each) for each in list(runs)[:MOST_RUNS]]
        except CodecError:
            return
        self._write(dependences.lineage, {"runs": data})

    # --- one claim ------------------------------------------------------------------------------

    def _known(self, dependences: Dependences, claim: Claim) -> Known | None:
        asked = dependences.asked(claim)
        data = self._read(asked)
        if data is None:
            return None
        try:
            for entry in data["alike"]:
                names = tuple(entry["names"])
                if dependences.key(claim, names) == entry["key"]:
                    layout = entry["layout"]
                    if layout is not None and dependences.layout(names) != layout:
                        continue
                    found = self._revived(dependences, claim, revived(entry["verdict"]))
                    if found is not None:
                        return Known(found, names)
        except (CodecError, TypeError, AttributeError, LookupError):
            self._damaged(asked)
        return None

    def _revived(self, dependences: Dependences, claim: Claim, verdict: object) -> Verdict | None:
        if not isinstance(verdict, Verdict):
            raise CodecError("this is no verdict")
        verdict = replace(verdict, claim=claim, kept=True)
        if verdict.counterexample is None:
            return verdict if verdict.outcome is Outcome.HOLDS else None
        system = verdict.broken_system(dependences.system)
        shown = _shown(system, claim, verdict.counterexample)
        return None if shown is None else replace(verdict, counterexample=shown)

    def _keep(
        self,
        dependences: Dependences,
        verdict: Verdict,
        lemmas: Sequence[Names],
        *,
        whole: bool,
    ) -> None:
        claim = verdict.claim
        violated = verdict.counterexample is not None
        names = dependences.looked_at(claim, lemmas, whole=whole or violated)
        key = dependences.key(claim, names)
        if key is None:
            return
        # Slots stand in invariants and in runs.
        has_slots = violated or bool(verdict.lemmas)
        try:
            entry = {
                "names": names,
                "key": key,
                "layout": dependences.layout(names) if has_slots else None,
                "verdict": plain(replace(verdict, claim=NO_FAULT, step=None)),
            }
        except CodecError:
            return
        asked = dependences.asked(claim)
        before = self._read(asked) or {}
        alike = [each for each in _entries(before) if each.get("key") != key]
        self._write(asked, {"alike": [entry, *alike[: MOST_ALIKE - 1]]})

    # --- data -----------------------------------------------------------------------------------

    def _read(self, key: str) -> dict[str, Any] | None:
        raw = self.store.get(key)
        if raw is None:
            return None
        import json

        try:
            data = json.loads(raw)
        except ValueError:
            data = None
        if not isinstance(data, dict):
            self._damaged(key)
            return None
        return data

    def _write(self, key: str, data: Mapping[str, object]) -> None:
        import json

        self.store.put(key, json.dumps(data, separators=(",", ":")).encode("ascii"))

    def _damaged(self, key: str) -> None:
        self.store.drop(key)
        self.note(f"a kept verdict is damaged, and was removed: {key}")


def _is_fact(verdict: Verdict, *, lasting: bool) -> bool:
    """Return whether a verdict is kept. ``lasting``: with more time nothing else would come out."""
    match verdict.outcome:
        case Outcome.HOLDS:
            return verdict.rounds is None or lasting
        case Outcome.VIOLATED:
            return not verdict.others and verdict.ways is None
        case Outcome.UNKNOWN:
            return False


def _shown(system: System, claim: Claim, kept: Counterexample) -> Counterexample | None:
    """A kept counterexample, replayed on the whole system; None if it breaks nothing there."""
    # What replays loads Z3, which is not needed where claims hold.
    from koord.verify.verdicts import NotReplayedError
    from koord.verify.witness import replayed

    recording = kept.recording
    try:
        if claim.kind is ClaimKind.LIVENESS:
            from koord.verify.lasso_witness import replayed_lasso

            found = replayed_lasso(system, recording, claim)
        else:
            found = replayed(system, recording, claim, kept.phase)
    except (NotReplayedError, IllegalStepError, KoordError, AssertionError, LookupError):
        return None
    return found if found.round == kept.round else None


def _of_vacuities(
    dependences: Dependences, verdicts: Iterable[Verdict], names: Collection[str]
) -> tuple[str, list[Any]]:
    """The key of the vacuities of some verdicts, and the places in the text that they may have."""
    form = dependences.happening()
    stated = [form.text, *map(form.claim, dependences.claims)]
    said = [f"{v.claim.name} {v.outcome.value} {v.rounds} {v.engine.value}" for v in verdicts]
    key = digest("vacuities", dependences.question.text, *stated, *said, *sorted(names))
    return key, form.places


def _kinds_of(verdicts: Collection[Verdict]) -> Substance:
    """Whether verdicts are for every number of robots, and for all rounds."""
    return Substance(
        every_n=all(v.outcome is Outcome.HOLDS and v.engine is Engine.EVERY_N for v in verdicts),
        all_rounds=all(
            v.outcome is Outcome.VIOLATED or v.rounds is None
            for v in verdicts
            if v.claim.kind is not ClaimKind.LIVENESS
        ),
    )


def _of_happening(dependences: Dependences, form: Form, kinds: Substance) -> str:
    """The key of whether runs start and go on, and all happens that belongs to no claim."""
    kind = f"{kinds.every_n} {kinds.all_rounds}"
    return digest("happens", dependences.question.text, form.text, kind)


def _of_verdict(dependences: Dependences, form: Form, verdict: Verdict, kinds: Substance) -> str:
    """The key of whether a verdict says something."""
    kind = f"{kinds.every_n} {kinds.all_rounds}"
    said = f"{verdict.outcome.value} {verdict.rounds} {verdict.engine.value}"
    claim = form.claim(verdict.claim)
    return digest("says", dependences.question.text, form.text, kind, claim, said)


def _entries(data: Mapping[str, Any]) -> list[dict[str, Any]]:
    found = data.get("alike")
    return [each for each in found if isinstance(each, dict)] if isinstance(found, list) else []
