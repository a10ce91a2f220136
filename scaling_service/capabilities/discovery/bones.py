"""What is known of bones beside the effects: how skin slides over a knee, and where joints are expected.

Markers alone do not show what skin does as a whole over a bone. Two things say something of it: what skin did
over other people's bones, and the published smaller rotations of joints, about the posture in which the
markers were placed, which is where the model fits them best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws import candidates
from scaling_service.capabilities.discovery.search.findings import Findings
from scaling_service.capabilities.motion.result import TrackedTrial
from scaling_service.capabilities.motion.run import track
from scaling_service.core.names import say_name
from scaling_service.model import body
from scaling_service.model.anatomy.knees import SecondaryRotation, list_secondary_rotations
from scaling_service.model.anatomy.skin import slide_skin
from scaling_service.model.compile import evaluate_law

_FLEXED = np.radians(60.0)  # in walking (Winter 2009)
_BEST = 0.02  # of the frames; chosen: a second of standing in a minute of movement
_FEWEST = 3  # frames, and markers of a cluster, for which a rigid fit leaves a residual
_LEFT_OVER = 1.2  # chosen: times the noise floor, which itself is known to some 15 %
_IMPLAUSIBLE = 3.0  # chosen: deviations off, on average, beyond which the published does not hold here


@dataclass(frozen=True, slots=True, eq=False)
class BoneKnowledge:
    """What is added to the model beside the effects."""

    # Marker to what its skin slides along the axes of the segment with flexion, m, beside its place
    skin: dict[str, tuple[body.Law, body.Law, body.Law]] = field(default_factory=dict)
    expectations: tuple[body.Expectation, ...] = ()
    notes: tuple[str, ...] = ()

    def add_to(self, model: body.BodyModel) -> body.BodyModel:
        """A model with it."""
        markers = []
        for marker in model.markers:
            pairs = zip(
                marker.laws, self.skin.get(marker.name, (body.Law(), body.Law(), body.Law())), strict=True
            )
            x, y, z = (law + more for law, more in pairs)
            markers.append(replace(marker, laws=(x, y, z)))
        return replace(model, markers=tuple(markers), expectations=self.expectations)


def without_undetermined(fit: Fit, findings: Findings) -> tuple[Fit, tuple[str, ...]]:
    """The fit without named movements that skin as a whole could as well be, and their names.

    A law of skin or a joint set free moves the bones by what markers of a segment do alike, and that is what
    they do not show. It is believed where what was named explains those markers down to their noise; where
    more is left, skin moves there in ways that have no name, and a common part with them. The same holds of
    what cannot be told from such a movement.
    """
    alike = {named.key: tuple(named.equivalents) for named in findings.named}
    left_out = {
        effect.candidate.key: effect.candidate.name
        for effect in fit.effects
        if any(
            one.follows or isinstance(one.change, candidates.FreeMotion)  # moves from frame to frame
            for one in (effect.candidate, *alike.get(effect.candidate.key, ()))
        )
        and _measure_left_over(_list_segments(effect, fit.model), fit.model, findings) > _LEFT_OVER
    }
    reduced = fit.without(left_out)
    return reduced, tuple(left_out.values())


def _list_segments(effect: candidates.Estimate, model: body.BodyModel) -> set[str]:
    """Those whose markers it moves."""
    where = set(effect.candidate.where)
    found = {m.segment for m in model.markers if m.name in where}
    for segment in model.segments:
        if where & {segment.name, segment.joint_name}:
            found |= {segment.name, segment.parent}
    return found


def _measure_left_over(segments: set[str], model: body.BodyModel, findings: Findings) -> float:
    """What is left at the markers of some segments, times their noise floor."""
    after = floor = 0.0
    for gap in (findings.fit, findings.held_out):
        for name, level in gap.places.items():
            if name in model.marker_names and model.marker(name).segment in segments:
                after, floor = after + (level.after or 0.0) ** 2, floor + (level.floor or 0.0) ** 2
    return float(np.sqrt(after / floor)) if floor > 0.0 else 0.0


def learn_bones(model: body.BodyModel, fit: Fit) -> BoneKnowledge:
    """What people's skin and joints and the recordings to fit say; ``model``: with what was named there."""
    rotations = list(list_secondary_rotations(model))
    trials = [item.trial for item in fit.tracked if item.role == "fit"]
    if not rotations or not trials:
        return BoneKnowledge()
    sliding = BoneKnowledge(skin=slide_skin(model)).add_to(model)
    followed = [track(sliding, trial) for trial in trials]
    found = [_expect(rotation, sliding, followed) for rotation in rotations]
    return BoneKnowledge(
        slide_skin(model),
        tuple(one for one in found if isinstance(one, body.Expectation)),
        tuple(one for one in found if isinstance(one, str)),
    )


def measure_slide(laws: tuple[body.Law, body.Law, body.Law]) -> float:
    """How far skin slides where the knee flexes by 60 deg, m."""
    slopes = [sum(term.gain for term in law.terms) for law in laws]
    return float(_FLEXED * np.linalg.norm(slopes))


def _expect(
    rotation: SecondaryRotation, model: body.BodyModel, followed: Sequence[TrackedTrial]
) -> body.Expectation | str | None:
    """The rotation about the posture in which markers were placed; a sentence where it cannot hold here."""
    names = model.coordinate_names
    column, flexion = names.index(rotation.coordinate), names.index(rotation.flexion)
    segments, found = (rotation.parent, rotation.child), [np.zeros((4, 0))]
    for item in followed:
        q, sd = item.motion.q, item.uncertainty.sd[:, column]
        owners = np.array([model.marker(name).segment for name in item.motion.markers])
        if all(np.sum(owners == segment) >= _FEWEST for segment in segments):
            # Mean squared residual of both segments' markers in each frame, NaN where not all are seen
            gap = np.square(item.motion.residuals[:, np.isin(owners, segments)]).mean(axis=(1, 2))
            rows = np.stack([gap, q[:, column], q[:, flexion], sd])
            found.append(rows[:, np.isfinite(rows[[0, 2, 3]]).all(axis=0) & (sd > 0.0)])
    gap, turn, bent, sd = np.concatenate(found, axis=1)
    if len(gap) < _FEWEST:
        return None
    best = np.argsort(gap)[: max(_FEWEST, round(_BEST * len(gap)))]
    led = np.zeros_like(turn) + evaluate_law(rotation.law, {rotation.flexion: bent})
    reference = float(np.mean(turn[best] - led[best]))
    # Skin is out of place in the best frames, too, by as much less as it deforms less there.
    still = float(np.sqrt(np.mean(gap[best]) / np.mean(gap))) if gap.any() else 0.0
    unsure = float(np.sqrt(np.mean(sd**2)))
    spread = float(np.hypot(rotation.sd, still * unsure))
    off = float(np.sqrt(np.mean((turn - led - reference) ** 2) / (spread**2 + unsure**2)))
    if off > _IMPLAUSIBLE:
        return (
            f"{say_name(rotation.coordinate)} is {off:.1f} standard deviations off what is published of this "
            "joint: it is left to the markers"
        )
    law = rotation.law + body.Law.constant(reference)
    return body.Expectation(rotation.coordinate, law, spread, rotation.source)
