"""Something touches the body that no plate measures: a force of any course at a point of a segment."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping

import numpy as np

from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws import contacts
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Contact, Estimate
from scaling_service.capabilities.discovery.observations.wrench import WrenchFit
from scaling_service.capabilities.discovery.ordinary.forces import Touch
from scaling_service.capabilities.discovery.ordinary.sums import find_best_span
from scaling_service.capabilities.kinetics.forces import find_feet
from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody.rigid import build_skew

KIND = "external_contact"
_FORCE_N_PER_KG = 5.0  # SD along an axis (chosen: half a body weight)
_UNDERFOOT = math.log(20.0)  # chosen: most of what touches a body beside the plates is floor under a foot
_LEAST_N = 1.0  # of a force along an axis (chosen: plates tell it to that)
_STANDS_OUT = 2.0  # deviations of the force from which frames place the point (chosen)
_FEWEST = 5  # frames from which a point can be placed
_WEIGHED = 3  # of the likeliest segments, beside all else that is ordinary (chosen: the lead is among them)
_LASTING_S = 0.2  # the longer of the times of correlation, that of moments


def find_contacts(fit: Fit, ordinary: Mapping[str, Array]) -> list[tuple[float, Candidate]]:
    """The likeliest touches of segments in recordings, with the logarithm of their prior odds.

    ``ordinary``: what is ordinary of each component (6,) in each recording, N and N m.
    """
    found, feet = [], set(find_feet(fit.model))
    known = {e.candidate.where[0] for e in fit.effects if e.candidate.kind == KIND}  # in other recordings
    for item in fit.wrenches:
        noise = ordinary[item.name]
        out = np.abs(item.residuals[:, :3]) > _STANDS_OUT * noise[:3]
        rows = np.flatnonzero(item.usable & out.any(axis=1))
        if len(rows) < _FEWEST:
            continue
        shown = {item.model.marker(m).segment for m in item.tracked.markers}
        names = [s.name for s in item.model.segments if s.name in shown]
        weight = min(1.0, item.step / (2.0 * _LASTING_S))
        for name in names:
            point = contacts.fit_point(contacts.Spell(item, rows, noise), name)
            # Logarithm of the Bayes factor of each frame of a force of any direction at a point, (n,).
            columns = _press(item, name, point) / noise[:, None]
            gap, sd = item.residuals / noise, _FORCE_N_PER_KG * item.mass
            x = np.einsum("nak,na->nk", columns, gap)
            scaled = np.eye(3) + sd**2 * np.einsum("nak,nal->nkl", columns, columns)
            size = sd**2 * np.linalg.solve(scaled, x[:, :, None])[:, :, 0]
            gains = np.asarray(0.5 * (x * size).sum(axis=1) - 0.5 * np.linalg.slogdet(scaled)[1])
            gain, span = find_best_span(np.where(item.usable, gains, 0.0))
            inside = np.arange(span.start, span.stop)[item.usable[span]]
            if len(inside) < _FEWEST:
                continue
            contact = _make_contact(contacts.Spell(item, inside, noise), name, point)
            candidate = Candidate(kind=KIND, where=(name,), columns=(), trials=(item.name,), change=contact)
            common = _UNDERFOOT if name in feet else 0.0
            places = 0.0 if name in known else math.log(len(names))
            found.append((weight * gain, common - places - _count_spans(item), candidate))
    of_segment: dict[str, float] = defaultdict(float)
    for gain, odds, candidate in found:
        of_segment[candidate.where[0]] += gain + odds
    likely = sorted(of_segment, key=lambda name: -of_segment[name])[:_WEIGHED]
    return [(odds, candidate) for _, odds, candidate in found if candidate.where[0] in likely]


def make_touch(fit: Fit, candidate: Candidate) -> Touch:
    """A touch as the evidence weighs it; its course is as lively as what is missing there."""
    contact = candidate.change
    assert isinstance(contact, Contact)
    item = next(w for w in fit.wrenches if candidate.holds_in(w.name))
    frames = (item.times >= contact.start_s) & (item.times <= contact.end_s)
    missing = item.residuals[:, :3] + (0.0 if item.touched is None else item.touched[:, :3])
    return Touch(
        segment=contact.segment,
        trial=item.name,
        frames=frames,
        columns=_press(item, contact.segment, np.array(contact.point)),
        sd=_FORCE_N_PER_KG * item.mass,
        wandering=np.maximum(missing[frames & item.usable].std(axis=0), _LEAST_N),
        spans=_count_spans(item),
    )


def _count_spans(item: WrenchFit) -> float:
    """Logarithm of the number of spans of time that are told apart in a recording."""
    return 2.0 * math.log(max(min(1.0, item.step / (2.0 * _LASTING_S)) * len(item.times), 1.0))


def _press(item: WrenchFit, segment: str, point: Array) -> Array:
    """What a force along each axis at a point of a segment does, (n, 6, 3), moment about the trunk."""
    arm = build_skew(contacts.locate(item, segment, point) - item.about)
    return np.concatenate([np.broadcast_to(np.eye(3), arm.shape), arm], axis=1)


def _make_contact(spell: contacts.Spell, segment: str, point: Array) -> Contact:
    x, y, z = (float(v) for v in point)
    item = spell.wrench
    start, end = float(item.times[0]), float(item.times[-1])
    if not contacts.is_throughout(item, spell.rows):
        (start, _), (end, _) = contacts.fit_edges(spell, item.residuals[:, :3])
    return Contact(
        segment=segment, start_s=start, end_s=end, point=(x, y, z), noise=tuple(spell.noise.tolist())
    )


def _describe_contact(effect: Estimate, after: Fit) -> Mapping[str, float]:
    """From when to when, where on the segment, and how strong."""
    contact = effect.candidate.change
    assert isinstance(contact, Contact)
    point = dict(zip(("x_mm", "y_mm", "z_mm"), (1e3 * v for v in contact.point), strict=True))
    rms, _ = _measure_rms(_find_touched(effect, after), contact)
    return {"start_s": contact.start_s, "end_s": contact.end_s, "rms_N": rms, **point}


def _estimate_contact_spreads(effect: Estimate, after: Fit) -> Mapping[str, float]:
    """Of its beginning, end and strength, where it has both of the former."""
    contact = effect.candidate.change
    assert isinstance(contact, Contact)
    item = _find_touched(effect, after)
    edges = contacts.find_edges(item, contact)
    if edges is None:
        return {}
    (_, of_start), (_, of_end) = edges
    rms, of_noise = _measure_rms(item, contact)
    # The mean square over an interval that is longer by a share is smaller by that share; a force that grows
    # and fades slowly hides at both ends.
    of_interval = 0.5 * rms * (of_start + of_end) / (contact.end_s - contact.start_s)
    return {"start_s": of_start, "end_s": of_end, "rms_N": float(np.hypot(of_noise, of_interval))}


def _find_touched(effect: Estimate, after: Fit) -> WrenchFit:
    return next(item for item in after.wrenches if effect.candidate.holds_in(item.name))


def _measure_rms(item: WrenchFit, contact: Contact) -> tuple[float, float]:
    """RMS of the force inferred, free of what noise adds to it, and what noise makes of it, N."""
    assert item.touched is not None
    inside = (item.times >= contact.start_s) & (item.times <= contact.end_s) & item.usable
    independent = inside.sum() * 2.0 * item.cutoff_hz / item.tracked.trial.rate_hz
    if independent < 1.0:
        return float("nan"), float("nan")
    added = float(np.square(contact.noise[:3]).sum())
    square = float(np.square(item.touched[inside, :3]).sum(axis=1).mean())
    return float(np.sqrt(max(square - added, 0.0))), float(np.sqrt(added / 3.0 / independent))


EFFECTS = (
    Effect(
        kind=KIND,
        meaning="something touches the segment that no plate measures",
        details=_describe_contact,
        spreads=_estimate_contact_spreads,
    ),
)
