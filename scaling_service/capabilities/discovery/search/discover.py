"""Find what stands out of what is ordinary for people, and show what it was.

Labels first, then the body and its markers, then the weight and the forces. The likeliest is named, the
recordings are tracked anew with it, and so on until nothing has the odds. Nothing is named whose own places,
or whose forces or markers as a whole, are worse with it on what did not fit it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from scaling_service.capabilities.discovery.effects.body_mass import question_mass
from scaling_service.capabilities.discovery.effects.catalogue import (
    describe_details,
    estimate_spreads,
    propose_candidates,
)
from scaling_service.capabilities.discovery.effects.external_contact import find_contacts
from scaling_service.capabilities.discovery.effects.marker_swap import find_exchange
from scaling_service.capabilities.discovery.effects.sizes import list_usual_deviations
from scaling_service.capabilities.discovery.evidence.fit import (
    Fit,
    Recording,
    SearchContext,
    fit_recordings,
    fit_wrenches,
)
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, Reweighed
from scaling_service.capabilities.discovery.observations.tracked import ROLES
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS
from scaling_service.capabilities.discovery.ordinary.forces import (
    Evidence,
    Loads,
    WrenchTable,
    measure_noise,
    score_loads,
)
from scaling_service.capabilities.discovery.ordinary.levels import SPREAD
from scaling_service.capabilities.discovery.search.findings import (
    Findings,
    NamedEffect,
    Tried,
    Unexplained,
    Verdict,
    classify_place,
)
from scaling_service.capabilities.discovery.search.gaps import (
    Expected,
    Yardstick,
    describe_course,
    expect_markers,
    list_disagreements,
    measure_gap,
    rms_by_place,
)
from scaling_service.capabilities.discovery.search.markers import BodyTable, Ranked
from scaling_service.core.progress import Progress, Steps, show_nothing
from scaling_service.core.threads import map_parallel
from scaling_service.model.body import BodyModel
from scaling_service.numerics.multibody.laws import Array

_LABELS, _BODY, _FORCES = 0.1, 0.6, 0.9  # of the work, where its parts end (chosen)
_RIVALS = 2.0  # times the difference of a class: rivals at the same place that are tracked, too (chosen)
_SHOWN = 30  # of what was not named (chosen)
_MOVED = 0.3  # deviations by which sizes must move to be worth tracking anew (chosen)


@dataclass(frozen=True, slots=True, eq=False)
class Discovery:
    """The whole story, and the two fits between which it goes."""

    findings: Findings
    before: Fit
    after: Fit


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Where the model comes from.

    ``given``: it was made for the person elsewhere; ``placed``: its markers' places were fitted;
    ``declared_kg``: the person's mass, if it was declared.
    """

    given: bool = False
    placed: bool = True
    declared_kg: float | None = None


def discover(
    model: BodyModel,
    recordings: Sequence[Recording],
    settings: DiscoverySettings = DiscoverySettings(),
    progress: Progress | None = None,
    notes: Sequence[str] = (),
    origin: Origin = Origin(),
) -> Discovery:
    """Search the catalogue for what the model does not have.

    Parameters
    ----------
    model : BodyModel
        Without parameters; with mass where forces are given.
    recordings : sequence of Recording
        Not smoothed, not filled.
    notes : sequence of str
        What is known already of what could not be tried.

    Raises
    ------
    TrialUnusable
        A trial shows no marker of the model.
    """
    steps = Steps(report=progress or show_nothing)
    steps.begin("following the recordings", 0.0, _LABELS)
    context = SearchContext(model=model, recordings=recordings, settings=settings, advance=steps.advance)
    before = fit_recordings(context)
    search = _Search(fit=before, origin=origin, steps=steps)
    search.find_labels()
    body = search.search_body()
    forces = search.search_forces()
    steps.begin("measuring the gap", _FORCES, 1.0)
    findings = _summarise(search, before, body, forces, notes)
    steps.begin("done", 1.0, 1.0)
    return Discovery(findings, before, search.fit)


@dataclass(slots=True, eq=False, kw_only=True)
class _Named:
    """What was named so far."""

    ranked: Ranked
    gain: float
    by_blocks: bool
    equivalents: Mapping[Candidate, float]
    smallest: Mapping[str, float]


@dataclass(slots=True, eq=False, kw_only=True)
class _Search:
    """What is assumed by now."""

    fit: Fit
    origin: Origin
    steps: Steps
    named: list[_Named] = field(default_factory=list)
    refused: set[str] = field(default_factory=set)  # keys
    tried: dict[str, Tried] = field(default_factory=dict)
    covariances: dict[str, Array] = field(default_factory=dict)
    reason: str = ""

    @property
    def settings(self) -> DiscoverySettings:
        """How strict it is."""
        return self.fit.settings

    # Labels

    def find_labels(self) -> None:
        """Exchanges, one after the other, before anything else is believed of the markers."""
        self.steps.begin("looking for exchanged labels", 0.0, _LABELS)
        for _ in range(self.settings.most):
            found = [one for one in map_parallel(find_exchange, self.fit.tracked) if one is not None]
            ranked = sorted((Ranked(odds, c) for odds, c in found), key=lambda one: -one.odds)
            if not self._name_first(ranked, self._refit_markers, {}):
                break

    # The body

    def search_body(self) -> BodyTable:
        """Until nothing of the body and its markers stands out; the last table."""
        for count in range(self.settings.most + 1):
            share = _LABELS + (_BODY - _LABELS) * count / self.settings.most
            self.steps.begin(f"looking for effect {len(self.named) + 1}", share, _BODY)
            body = self._make_table()
            ranked = body.rank()
            self._remember(ranked, sum(s.square for s in body.table.sums))
            if count == self.settings.most:
                break
            chosen = self._reorder(body, ranked)
            classes = self._tell_classes(chosen, body.compare)
            if not self._name_first(chosen, self._refit_markers, classes):
                break
        return body

    def _make_table(self) -> BodyTable:
        """With all sizes estimated together; tracked once more where they moved."""
        body = self._tabulate(self.fit)
        again = body.reestimate()
        self.covariances |= {e.candidate.key: covariance for e, covariance in again}
        moved = {e.candidate.key: e for e, c in again if self._has_moved(e, c)}
        if not moved:
            return body
        effects = tuple(moved.get(e.candidate.key, e) for e in self.fit.effects)
        self.fit = self._refit_markers(effects)
        return self._tabulate(self.fit, body)

    def _has_moved(self, effect: Estimate, covariance: Array) -> bool:
        before = next(e for e in self.fit.effects if e.candidate.key == effect.candidate.key)
        sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        return bool((np.abs(effect.size - before.size) > _MOVED * sd).any())

    def _tabulate(self, fit: Fit, like: BodyTable | None = None) -> BodyTable:
        return BodyTable.of(fit, given=self.origin.given, placed=self.origin.placed, like=like)

    def _reorder(self, body: BodyTable, ranked: list[Ranked]) -> list[Ranked]:
        """With the first and its rivals at the same place compared once more, as tracked with each.

        One step of a linear table does not tell a turned axis from a law that follows the angle.
        """
        first = next((r for r in ranked if r.candidate.key not in self.refused), None)
        if first is None or first.odds < self.settings.odds or first.scored is None:
            return ranked
        near = first.odds - _RIVALS * self.settings.class_odds
        rivals = {
            r.candidate.kind: r
            for r in reversed(ranked)
            if r.odds > near
            and r.scored is not None
            and set(r.candidate.where) & set(first.candidate.where)
            and r.candidate.trials == first.candidate.trials
            and r.candidate.key not in self.refused
        }
        if len(rivals) < 2:
            return ranked
        bias = {r.candidate.key: r.odds for r in ranked}
        found = {}
        for r in rivals.values():
            assert r.scored is not None
            fit = self._refit_markers((*self.fit.effects, Estimate(r.candidate, r.scored.size)))
            prior = r.odds - r.scored.bayes  # of its kind and places
            found[r.candidate.key] = self._tabulate(fit, body).table.evidence + prior
        best = max(found, key=lambda key: found[key])
        lead = bias[first.candidate.key]
        return sorted(
            (
                replace(r, odds=lead + found[r.candidate.key] - found[best])
                if r.candidate.key in found
                else r
                for r in ranked
            ),
            key=lambda r: (-r.odds, r.candidate.key != best),
        )

    def _refit_markers(self, effects: Sequence[Estimate]) -> Fit:
        return fit_recordings(self.fit.context, effects, self.fit)

    # Forces

    def search_forces(self) -> tuple[WrenchTable, Evidence] | None:
        """The weight, and then what stands out of the forces; the last table."""
        if not self.fit.wrenches or not self.fit.scene.plates:
            return None
        mass = question_mass(self.fit, self.origin.declared_kg)
        if mass is not None:
            assert isinstance(mass.change, Reweighed)
            z = (mass.change.factor - 1.0) / max(mass.change.sd, 1e-6)
            self._name_first([Ranked(0.5 * z * z, mass)], self._refit_forces, {})
        for count in range(self.settings.most + 1):
            share = _BODY + (_FORCES - _BODY) * count / self.settings.most
            self.steps.begin(f"looking for effect {len(self.named) + 1}", share, _FORCES)
            loads, ranked = self._rank_forces()
            self._remember(ranked, loads.square)
            if count == self.settings.most:
                break
            classes = self._tell_classes(ranked, _Alike(loads, [c for c, _ in self._list_loads()]))
            if not self._name_first(ranked, self._refit_forces, classes):
                break
        return loads.table, loads.none

    def _list_loads(self) -> list[tuple[Candidate, Array]]:
        pairs = [
            (c, list_usual_deviations(c, self.fit.model))
            for c in propose_candidates(self.fit.scene)
            if is_of_forces(c)
        ]
        return [(c, sd) for c, sd in pairs if sd is not None]

    def _rank_forces(self) -> tuple[Loads, list[Ranked]]:
        """All candidates of the wrench, those named estimated together."""
        choice = self._list_loads()
        named = [
            (e, sd)
            for e in self.fit.effects
            if is_of_forces(e.candidate)
            and (sd := list_usual_deviations(e.candidate, self.fit.model)) is not None
        ]
        loads = score_loads(self.fit, choice, named)
        self.covariances |= {e.candidate.key: covariance for e, covariance in loads.named}
        moved = {e.candidate.key: e for e, c in loads.named if self._has_moved(e, c)}
        if moved:
            self.fit = self._refit_forces([moved.get(e.candidate.key, e) for e in self.fit.effects])
        places = Counter(c.kind for c, _ in choice)
        ranked = [
            Ranked(s.bayes - math.log(places[c.kind]), c, s)
            for (c, _), s in zip(choice, loads.scored, strict=True)
        ]
        noise = measure_noise(loads.table, loads.none.levels)
        ranked += [Ranked(odds, c) for odds, c in find_contacts(self.fit, noise)]
        return loads, sorted(ranked, key=lambda one: -one.odds)

    def _refit_forces(self, effects: Sequence[Estimate]) -> Fit:
        return fit_wrenches(replace(self.fit, effects=tuple(effects)))

    # Naming

    def _name_first(
        self,
        ranked: Sequence[Ranked],
        refit: Callable[[Sequence[Estimate]], Fit],
        classes: Mapping[str, Mapping[Candidate, float]],
    ) -> bool:
        """Name the first that has the odds and does good; whether there was one."""
        taken = {e.candidate.key for e in self.fit.effects}
        for one in ranked:
            key = one.candidate.key
            if one.odds < self.settings.odds:
                break
            if key in self.refused or key in taken:
                continue
            size = np.zeros(0) if one.scored is None else one.scored.size
            if not one.candidate.plausible(size) and one.scored is not None:
                self.refused.add(key)
                continue
            fit = refit((*self.fit.effects, Estimate(one.candidate, size)))
            gain, by_blocks = self._measure_gain(fit, one.candidate)
            if gain is None:
                self.refused.add(key)
                continue
            self.fit = fit
            self.covariances[key] = np.zeros((0, 0)) if one.scored is None else one.scored.covariance
            self.named.append(
                _Named(
                    ranked=one,
                    gain=gain,
                    by_blocks=by_blocks,
                    equivalents=classes.get(key, {}),
                    smallest=self._find_smallest(one),
                )
            )
            return True
        return False

    def _measure_gain(self, fit: Fit, candidate: Candidate) -> tuple[float | None, bool]:
        """Share of the squares that it takes off what did not fit it; None where anything is worse there."""
        forces = not is_of_markers(candidate)
        here = [r.trial.name for r in fit.context.recordings if candidate.holds_in(r.trial.name)]
        unseen = [
            r.trial.name for r in fit.context.recordings if r.role == "held_out" and r.trial.name in here
        ]
        trials = unseen or here
        old, new = (rms_by_place(f, trials, forces=forces) for f in (self.fit, fit))
        worst = 1.0 + self.settings.worse
        own = [w for w in candidate.where if w in old and w in new]
        if any(new[w] > worst * old[w] for w in own):
            return None, not unseen
        groups = (COMPONENTS[:3], COMPONENTS[3:]) if forces else (tuple(old),)
        gains, fell = [], []
        for group in groups:
            a, b = (sum(rms[p] ** 2 for p in group if p in rms) for rms in (old, new))
            fell.append(b <= worst**2 * a)
            gains.append(1.0 - b / a if a > 0.0 else 0.0)
        return (max(gains) if all(fell) and max(gains) > 0.0 else None), not unseen

    def _tell_classes(
        self, ranked: Sequence[Ranked], compare: Callable[[Ranked, Ranked], float]
    ) -> dict[str, dict[Candidate, float]]:
        """Of the first that has the odds: those that these recordings do not tell from it."""
        first = next((r for r in ranked if r.candidate.key not in self.refused), None)
        if first is None or first.odds < self.settings.odds or first.scored is None:
            return {}
        near = [r for r in ranked if r is not first and r.odds > first.odds - self.settings.class_odds]
        own = first.candidate
        alike = {
            r.candidate: r.odds - first.odds
            for r in near
            if (r.candidate.kind, r.candidate.where) != (own.kind, own.where)
            and abs(compare(first, r)) > self.settings.class_cosine
        }
        return {first.candidate.key: alike}

    def _find_smallest(self, one: Ranked) -> dict[str, float]:
        """Sizes of the columns, in proportion as found, from which a share would be named."""
        if one.scored is None:
            return {}
        s = one.scored
        scaled = np.eye(len(s.sd)) + s.information * np.outer(s.sd, s.sd)
        shown = s.information @ s.size
        strength = float(shown @ (s.sd * np.linalg.solve(scaled, s.sd * shown)))
        needed = self.settings.odds + (s.bayes - one.odds) + 0.5 * float(np.linalg.slogdet(scaled)[1])
        if strength <= 0.0 or needed <= 0.0:
            return {}
        z = float(scipy.stats.norm.ppf(self.settings.power))
        share = (z + math.sqrt(z * z + 2.0 * needed)) / math.sqrt(strength)
        return {
            column.name: abs(column.unit * size) * share
            for column, size in zip(one.candidate.columns, s.size.tolist(), strict=True)
        }

    def _remember(self, ranked: Sequence[Ranked], square: float) -> None:
        """What was tried, as it was last, and what of the squares it would take."""
        for r in ranked[:_SHOWN]:
            s = r.scored
            gain = float("nan") if s is None else float(s.size @ s.information @ s.size) / square
            self.tried[r.candidate.key] = Tried(candidate=r.candidate, odds=r.odds, gain=gain)


def is_of_forces(candidate: Candidate) -> bool:
    """Whether a candidate is a sum of columns of the wrench."""
    return bool(candidate.columns) and all(column.load is not None for column in candidate.columns)


def is_of_markers(candidate: Candidate) -> bool:
    """Whether a candidate shows among the markers."""
    return candidate.seen_in == "markers"


@dataclass(frozen=True, slots=True, eq=False)
class _Alike:
    """Cosine between what two candidates of the wrench explain, as they were found."""

    loads: Loads
    choice: Sequence[Candidate]

    def __call__(self, one: Ranked, other: Ranked) -> float:
        """0 of what has no columns."""
        if one.scored is None or other.scored is None:
            return 0.0
        table, keys = self.loads.table, [c.key for c in self.choice]
        scale = np.sqrt(table.weight) / (table.sd * self.loads.none.levels)
        a, b = (
            (scale * table.explain(table.numbers[keys.index(r.candidate.key)], s.size)).ravel()
            for r, s in ((one, one.scored), (other, other.scored))
        )
        return float(a @ b / math.sqrt(max(float(a @ a) * float(b @ b), 1e-300)))


_NOTHING_MORE = "nothing more stands out of what is ordinary for people"
_SPENT = "{} effects of one kind were named, the most that are looked for"


def _summarise(
    search: _Search,
    before: Fit,
    body: BodyTable,
    forces: tuple[WrenchTable, Evidence] | None,
    notes: Sequence[str],
) -> Findings:
    """Where, what, how far the gap closed, and what is left."""
    after, settings = search.fit, search.settings
    expected = None
    if forces is not None:
        table, none = forces
        ordinary, left = measure_noise(table, none.levels).tolist(), none.left.tolist()
        expected = Expected(*(dict(zip(COMPONENTS, values, strict=True)) for values in (ordinary, left)))
    yardstick = Yardstick(expect_markers(body), expected)
    folds = not any(item.role == "held_out" for item in before.tracked)
    gaps = {role: measure_gap(before, after, role, yardstick) for role in (ROLES[:1] if folds else ROLES)}
    named = tuple(sorted((_finish(one, search) for one in search.named), key=lambda n: -n.odds))
    unexplained = _list_unexplained(search, body, forces, yardstick)
    verdict: Verdict = "found" if named else "unexplained" if unexplained else "nothing"
    spent = sum(is_of_markers(n.candidate) for n in named) >= settings.most
    taken = {n.key for n in named}
    tried = sorted((r for r in search.tried.values() if r.candidate.key not in taken), key=lambda r: -r.odds)
    said = ["no trial was held out: what is named was not tried on others"] if folds else []
    return Findings(
        verdict=verdict,
        disagreements=list_disagreements(before, yardstick),
        named=named,
        fit=gaps[ROLES[0]],
        held_out=gaps[ROLES[0] if folds else ROLES[1]],
        folds=folds,
        tried=tuple(tried[:_SHOWN]),
        unexplained=unexplained,
        reason=_SPENT.format(settings.most) if spent else _NOTHING_MORE,
        notes=(*notes, *said),
    )


def _finish(one: _Named, search: _Search) -> NamedEffect:
    """With its size and numbers as they are in the end."""
    key = one.ranked.candidate.key
    effect = next(e for e in search.fit.effects if e.candidate.key == key)
    return NamedEffect(
        effect=effect,
        covariance=search.covariances[key],
        odds=one.ranked.odds,
        gain=one.gain,
        by_blocks=one.by_blocks,
        smallest=one.smallest,
        equivalents=one.equivalents,
        details=describe_details(effect, search.fit),
        spreads=estimate_spreads(effect, search.fit),
    )


def _list_unexplained(
    search: _Search, body: BodyTable, forces: tuple[WrenchTable, Evidence] | None, yardstick: Yardstick
) -> tuple[Unexplained, ...]:
    """Places that are livelier than the others of the person by more than places of a person differ."""
    limit, fit, found = search.settings.unexplained, search.fit, []
    names = [item.name for item in fit.tracked]
    rms = rms_by_place(fit, names, forces=False)
    for marker, (level, count) in body.measure_liveliness().items():
        spread = math.hypot(SPREAD, 1.0 / math.sqrt(2.0 * count))
        if level > 1.0 and math.log(level) > limit * spread:
            floor = math.sqrt(
                np.mean([e.ordinary[marker] ** 2 for e in yardstick.markers.values() if marker in e.ordinary])
            )
            found.append((math.log(level), marker, rms.get(marker, 0.0), floor))
    if forces is not None and yardstick.forces is not None:
        of_forces = rms_by_place(fit, names, forces=True)
        for component, level in zip(COMPONENTS, forces[1].levels.tolist(), strict=True):
            if math.log(level) > limit * SPREAD:
                floor = yardstick.forces.ordinary[component] / level
                found.append((math.log(level), component, of_forces.get(component, 0.0), floor))
    return tuple(
        Unexplained(
            where=(place,),
            observable=classify_place(place),
            law=describe_course(fit, place) or "it follows no coordinate",
            rms=size,
            floor=floor,
        )
        for _, place, size, floor in sorted(found, reverse=True)
    )
