"""A search told as its document: every number beside what laboratories meet, and what to do about it."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Iterator
from dataclasses import asdict

import numpy as np
import scipy

from scaling_service.capabilities.discovery import result as documents
from scaling_service.capabilities.discovery import words
from scaling_service.capabilities.discovery.bones import measure_slide
from scaling_service.capabilities.discovery.effects.sizes import cite_source_of_sizes, look_up_usual_sizes
from scaling_service.capabilities.discovery.laws import candidates
from scaling_service.capabilities.discovery.laws.apply import changes_forces, changes_markers
from scaling_service.capabilities.discovery.laws.bones import BoneKnowledge
from scaling_service.capabilities.discovery.laws.loads import Tilt
from scaling_service.capabilities.discovery.options import DiscoverSettings
from scaling_service.capabilities.discovery.search.discover import Discovery
from scaling_service.capabilities.discovery.search.findings import NamedEffect, turn_into_probability
from scaling_service.capabilities.discovery.search.leanings import Leanings
from scaling_service.capabilities.discovery.start import Prepared
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.provenance import record_provenance, repair_notes
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import evaluate_law

_MOMENTS = ("x_kgmm", "y_kgmm", "z_kgmm")
_ESTIMATED = ("segment_mass", "segment_com", "joint_centre_offset", "joint_axis_tilt")
_TOLD = 0.5  # share of what is not known beforehand that recordings must tell of a number (chosen)


def make_discovery_document(
    found: Discovery,
    prepared: Prepared,
    bones: BoneKnowledge,
    left_out: Collection[str],
    chosen: DiscoverSettings,
    settings: Settings,
    wall_s: float = 0.0,
) -> documents.DiscoveryDocument:
    """``discovery.json``; what lies beside it, and what that lacks, is known once it is written.

    ``left_out``: the names of effects that the model is without.
    """
    fitted, held_out = (
        [name for name, role in prepared.roles.items() if role == of] for of in ("fit", "held_out")
    )
    effects = [_make_effect(named, prepared.model, left_out) for named in found.named]
    effects.sort(key=lambda effect: not effect.carries)
    headline = words.write_headline(
        found.verdict, effects, found.held_out.whitened, found.unexplained, held_out=bool(held_out)
    )
    worse = words.describe_worse(found.held_out)
    provenance = record_provenance(
        prepared.loaded,
        prepared.loaded.session.dynamic,
        settings.resolved() | {"discover": chosen.resolved(), "search": asdict(found.after.settings)},
        settings.seed,
    )
    for name, forces in prepared.forces.items():
        provenance["repairs"][name] += repair_notes(forces.repairs)
    return documents.DiscoveryDocument(
        **provenance,
        verdict=found.verdict,
        headline=headline + worse,
        tone=words.choose_tone(found.verdict, effects, found.held_out.whitened, worse),
        reason=found.reason,
        disagreements=list(found.disagreements),
        effects=effects,
        gap=documents.BothGaps(fit=found.fit, held_out=found.held_out),
        tried=list(found.tried),
        estimates=list(_list_estimates(found.leanings)),
        unexplained=list(found.unexplained),
        bones=_make_bones(
            bones,
            [words.describe_place(e.candidate) for e in found.after.effects if e.candidate.name in left_out],
        ),
        start=prepared.start,
        fitted_trials=fitted,
        held_out_trials=held_out,
        trials_with_forces=[r.trial.name for r in prepared.recordings if r.contacts is not None],
        notes=list(dict.fromkeys(found.notes)),
        files=[],
        wall_s=round(wall_s, 3),
    )


def _make_bones(bones: BoneKnowledge, left_out: list[str]) -> documents.BonesDocument:
    """``left_out``: what was named and the model is without."""
    known = documents.BonesDocument(
        skin_mm={name: 1e3 * measure_slide(laws) for name, laws in bones.skin.items()},
        expectations=[
            documents.ExpectationDocument(
                coordinate=e.coordinate,
                at_rest_deg=math.degrees(evaluate_law(e.law, defaultdict(float))),
                follows=[t.coordinate for t in e.law.terms if t.coordinate is not None],
                sd_deg=math.degrees(e.sd),
                source=e.source,
            )
            for e in bones.expectations
        ],
        left_out=left_out,
    )
    return known.model_copy(update={"sentences": list(words.describe_bones(known))})


def _list_estimates(leanings: Leanings) -> Iterator[documents.EstimateDocument]:
    """What is told of single things of the model, the one that is most unlike it first."""
    posteriors = [one for one in leanings.each() if one[0].kind in _ESTIMATED]
    posteriors.sort(key=lambda one: -float(one[1] @ np.linalg.solve(one[2], one[1])))
    for candidate, size, covariance, prior in posteriors:
        sds = np.sqrt(np.diag(covariance))
        told = 1.0 - np.square(sds / prior) > _TOLD
        if told.any():
            numbers = zip(candidate.columns, size.tolist(), sds.tolist(), told.tolist(), strict=True)
            yield documents.EstimateDocument(
                **dict(documents.PlacedEffect.model_validate(candidate)),
                parameters={
                    c.name: documents.QuantityDocument(
                        value=c.neutral + c.unit * value, sd=abs(c.unit) * sd, determined=known
                    )
                    for c, value, sd, known in numbers
                },
            )


def _make_effect(named: NamedEffect, model: BodyModel, left_out: Collection[str]) -> documents.EffectDocument:
    """With every number beside what laboratories meet, how far it may be believed, and what to do."""
    candidate, member = named.candidate, named.member
    usual, numbers, sizes, cautions = look_up_usual_sizes(candidate, model), {}, [], []
    for name, number in _list_quantities(named).items():
        known = None if isinstance(number.value, tuple) else usual(name)
        if known is not None and not isinstance(number.value, tuple):
            sizes.append(known.chance(number.value, number.sd or 0.0))
            implausible = not known.low <= number.value <= known.high
            number = documents.QuantityDocument(**dict(number) | {"usual": (known.low, known.high)})
            if implausible:
                where = words.list_places(candidate.where)
                said = ": ".join(filter(None, (where, words.format_quantity(name, number))))
                met = f"{words.format_figures(known.low)} to {words.format_figures(known.high)} is met"
                cautions.append(f"{said} is implausible: {met} ({cite_source_of_sizes(candidate.kind)})")
        numbers[name] = number
    there, size = turn_into_probability(named.odds), min(sizes, default=None)
    sign = estimate_sign_probability(named.effect.size, named.covariance)
    own, *others = map(documents.PlacedEffect.model_validate, (candidate, *named.equivalents))
    as_class = member < words.TOLD_ALONE
    return documents.EffectDocument(
        **dict(own),
        name=words.describe_class([own, *others])
        if as_class
        else words.describe_effect(
            candidate.kind, candidate.where, candidate.driver, candidate.trials, numbers
        ),
        carries=named.carries,
        parameters=numbers,
        smallest_nameable={k: size for k, size in named.smallest.items() if math.isfinite(size)},
        advice=_advise(named, as_class=as_class, left_out=candidate.name in left_out),
        confusable_with=others,
        would_separate=named.would_separate or None,
        evidence=documents.EvidenceDocument(
            gain_held_out=named.gain,
            log_odds=named.odds,
            p_family_wise=1.0 - there,
            by_blocks=named.by_blocks,
            summary=words.describe_evidence(
                named.gain,
                1.0 - there,
                by_blocks=named.by_blocks,
                by_weight=isinstance(candidate.change, candidates.Reweighed),
            ),
        ),
        belief=documents.BeliefDocument(
            effect=there,
            member=member,
            sign=sign,
            size=size,
            summary=words.describe_belief(there, member, sign, size),
            cautions=cautions,
        ),
    )


def _advise(named: NamedEffect, *, as_class: bool, left_out: bool) -> str:
    """What to do about an effect: where it is mended already, or who has to."""
    candidate, apart = named.candidate, named.would_separate
    record = (
        f" {apart[:1].upper()}{apart[1:]}, recorded as well, would tell it from what is like it."
        if apart
        else ""
    )
    if as_class:
        return f"Do not rely on one of them.{record}"
    if isinstance(candidate.change, candidates.Reweighed):
        return "Correct the person's mass in the subject file, or the plates' scale." + record
    if isinstance(candidate.change, candidates.Contact):
        return f"{candidate.trials[0]}_contact.sto has the force that it must have been." + record
    if any(isinstance(column.load, Tilt) for column in candidate.columns):
        return "Level the laboratory's axes by it." + record
    if changes_markers(candidate) or changes_forces(candidate):
        return "Use the recordings in corrected/, which are free of it, and mend its cause." + record
    if left_out:
        return "It is not in the model: these recordings do not show where it takes the bones." + record
    if candidate.trials:
        return f"Use {' and '.join(f'{trial}_model.json' for trial in candidate.trials)} there." + record
    return "Use model.json, which has it." + record


def estimate_sign_probability(values: Array, covariance: Array) -> float | None:
    """How probable it is that all of it, in the found proportions, points the way that was found.

    None where no number has a deviation. Numbers (k,) and covariance (k, k) count in deviations.
    """
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = sd > 0.0
    if not known.any():
        return None
    z, spread = values[known] / sd[known], covariance[np.ix_(known, known)] / np.outer(sd[known], sd[known])
    length = float(z @ spread @ z)
    return float(scipy.special.ndtr(z @ z / math.sqrt(length))) if length > 0.0 else 0.5


def _list_quantities(named: NamedEffect) -> dict[str, documents.QuantityDocument]:
    """Every number of an effect by its name in the results."""
    columns = named.effect.candidate.columns
    names = [column.name for column in columns]
    units = np.array([column.unit for column in columns])
    values = np.array([column.neutral for column in columns]) + units * named.effect.size
    covariance = np.asarray(named.covariance, dtype=float).reshape(len(columns), len(columns))
    covariance = covariance * np.outer(units, units)
    if set(_MOMENTS) < set(names):
        # A carried load's first moments as a place: moments over mass, errors to first order.
        mass, at = names.index("kg"), [names.index(name) for name in _MOMENTS]
        kg = float(values[mass])
        place = values[at] / kg
        slope = np.zeros((4, len(values)))
        slope[0, mass] = 1.0
        slope[[1, 2, 3], at] = 1.0 / kg
        slope[1:, mass] = -place / kg
        names, values = ["kg", "x_mm", "y_mm", "z_mm"], np.array([kg, *place])
        covariance = slope @ covariance @ slope.T
    sds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sds = np.array([named.spreads.get(name, sd) for name, sd in zip(names, sds.tolist(), strict=True)])
    found = {
        name: documents.QuantityDocument(
            value=value, sd=sd if sd > 0.0 else None, determined=sd > 0.0 or not any(sds)
        )
        for name, value, sd in zip(names, values.tolist(), sds.tolist(), strict=True)
    }
    change = named.effect.candidate.change
    if isinstance(change, candidates.FreeMotion):
        found["axis"] = documents.QuantityDocument(value=change.axis, sd=None)
    for name, value in named.details.items():
        if math.isfinite(value) and name not in found and not name.startswith("axis_"):
            found[name] = documents.QuantityDocument(value=value, sd=named.spreads.get(name))
    return found
