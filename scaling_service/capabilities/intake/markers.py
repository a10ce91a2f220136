"""Which label is which marker of the model: proposals, each with its confidence and its reason."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.intake.document import Candidate, MarkerProof
from scaling_service.model.anatomy.markers import likeness, looks_computed, meaning, strip_prefix
from scaling_service.model.body import BodyModel
from scaling_service.model.poses import neutral_markers
from scaling_service.model.trial import Array, Trial
from scaling_service.numerics.multibody.rigid import fit_rigid

CONFIDENCE: Mapping[str, float] = {
    "": 1.0,
    "prefix left out": 0.99,
    "capitals ignored": 0.95,
    "known alias": 0.9,
}
"""By what is left out of account in comparing names. Chosen: an order, not probabilities."""

AMBIGUOUS = 0.4
"""Chosen: of a marker that two labels fit equally well."""

NEAR_M, MOST_BY_PLACE = 0.12, 0.6
"""Chosen: a label farther than this from where the model expects a marker is not proposed for it, and one
right there is less sure than any name."""

FEWEST_KNOWN = 4
"""Markers that tell where the model stands (three, and one to spare)."""

_MOST_OTHERS = 3


@dataclass(frozen=True, slots=True)
class _Choice:
    label: str
    confidence: float
    why: str
    source: str


def propose(
    model: BodyModel,
    trials: Mapping[str, Trial],
    standing: Trial | None,
    document: Mapping[str, str],
    laboratory: Mapping[str, str],
) -> tuple[list[MarkerProof], list[str]]:
    """A label for every marker of a model.

    Parameters
    ----------
    model : BodyModel
    trials : mapping
        Name to recording, in one set of axes, m.
    standing : Trial, optional
        The one in which places are compared.
    document : mapping
        Model marker to label, as the subject's document says.
    laboratory : mapping
        Label to model marker, as the laboratory has them.

    Returns
    -------
    markers : list of MarkerProof
    unused : list of str
        Labels that no marker took.
    """
    labels = list(dict.fromkeys(label for trial in trials.values() for label in trial.labels))
    wanted = [m.name for m in model.markers if m.weight > 0.0]
    offers = {marker: list(_by_name(marker, labels, document, laboratory)) for marker in wanted}
    taken = _assigned(offers)
    if standing is not None:
        for marker, choice in _by_place(
            model, standing, taken, [m for m in wanted if m not in taken]
        ).items():
            taken[marker] = choice
    used = {choice.label for choice in taken.values()}
    unused = [label for label in labels if label not in used]
    entries = [_entry(model, marker, taken.get(marker), offers[marker], trials) for marker in wanted]
    return entries, unused


def _by_name(
    marker: str, labels: Sequence[str], document: Mapping[str, str], laboratory: Mapping[str, str]
) -> Iterator[_Choice]:
    for label in labels:
        plain = strip_prefix(label)
        if document.get(marker) in (label, plain):
            yield _Choice(label, 1.0, "as the subject's document says", "document")
        elif laboratory.get(label, laboratory.get(plain)) == marker:
            yield _Choice(label, 0.99, "as the laboratory's map says", "laboratory")
        elif (reason := likeness(label, marker)) is not None:
            yield _Choice(label, CONFIDENCE[reason], reason or "the same name", "name")


def _assigned(offers: Mapping[str, list[_Choice]]) -> dict[str, _Choice]:
    """The surest offers first; no label is used twice. Of two equally sure ones, the first, less sure."""
    taken: dict[str, _Choice] = {}
    used: set[str] = set()
    order = sorted(offers, key=lambda m: -max((c.confidence for c in offers[m]), default=0.0))
    for marker in order:
        free = sorted((c for c in offers[marker] if c.label not in used), key=lambda c: -c.confidence)
        if not free:
            continue
        best = free[0]
        rivals = [c.label for c in free[1:] if c.confidence == best.confidence]
        if rivals:
            why = f"{best.why}, but {' and '.join(rivals)} would fit as well"
            best = _Choice(best.label, AMBIGUOUS, why, best.source)
        taken[marker] = best
        used.add(best.label)
    return taken


def _by_place(
    model: BodyModel, standing: Trial, taken: Mapping[str, _Choice], missing: Sequence[str]
) -> dict[str, _Choice]:
    """Labels that lie where the model, standing as the person does, expects a marker.

    A label that a marker set knows stands for what it says, however near to another marker it lies.
    """
    used = {choice.label for choice in taken.values()}
    seen = {
        label: _middle(standing, label)
        for label in standing.labels
        if label in used or (meaning(label) is None and not looks_computed(label))
    }
    seen = {label: at for label, at in seen.items() if np.isfinite(at).all()}
    model_at = neutral_markers(model)
    known = [m for m, choice in taken.items() if choice.label in seen]
    if len(known) < FEWEST_KNOWN:
        return {}
    expected = _placed_like(
        model_at, [*known, *missing], known, np.stack([seen[taken[m].label] for m in known])
    )
    pairs = sorted(
        (float(np.linalg.norm(seen[label] - expected[marker])), marker, label)
        for marker in missing
        for label in seen
        if label not in used
    )
    found: dict[str, _Choice] = {}
    for distance, marker, label in pairs:
        if distance < NEAR_M and marker not in found and label not in {c.label for c in found.values()}:
            why = f"{1e3 * distance:.0f} mm from where the model expects it: check it"
            found[marker] = _Choice(label, MOST_BY_PLACE * (1.0 - distance / NEAR_M), why, "place")
    return found


def _middle(trial: Trial, label: str) -> Array:
    trajectory = trial.position(label)
    known = trajectory[np.isfinite(trajectory).all(axis=1)]
    return np.asarray(np.median(known, axis=0)) if len(known) else np.full(3, np.nan)


def _placed_like(
    model_at: Mapping[str, Array], names: Sequence[str], known: Sequence[str], measured: Array
) -> dict[str, Array]:
    """Markers of the standing model, sized and placed so that the known ones lie as measured."""
    local = np.stack([model_at[name] for name in known])
    size = _extent(measured) / _extent(local)
    R, t = fit_rigid(size * local, measured)
    return {name: R @ (size * model_at[name]) + t for name in names}


def _extent(points: Array) -> float:
    return float(np.linalg.norm(points - points.mean(axis=0)))


def _entry(
    model: BodyModel,
    name: str,
    choice: _Choice | None,
    offers: Sequence[_Choice],
    trials: Mapping[str, Trial],
) -> MarkerProof:
    marker = model.marker(name)
    others = [o for o in offers if choice is None or o.label != choice.label]
    return MarkerProof.model_validate(
        {
            "marker": name,
            "segment": marker.segment,
            "anatomical": marker.anatomical,
            "label": None if choice is None else choice.label,
            "confidence": 0.0 if choice is None else round(choice.confidence, 3),
            "why": "no label has this name or lies there" if choice is None else choice.why,
            "source": None if choice is None else choice.source,
            "recordings": [n for n, t in trials.items() if choice is not None and choice.label in t.labels],
            "others": [
                Candidate(label=o.label, confidence=o.confidence, why=o.why) for o in others[:_MOST_OTHERS]
            ],
        }
    )
