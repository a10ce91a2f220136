"""How far off each method's coordinates and lengths are, as the joint posterior has it.

Only the posterior counts all that is not known of a person. Whatever another method answers, the expected
square of its error is ``(answer - mean)² + variance``, of the posterior: what the method holds fixed or gets
wrong by construction is in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from scaling_service.capabilities.scaling.comparison.geometry import list_joint_angles
from scaling_service.capabilities.scaling.result import Scaling


def state_departures(scalings: Mapping[str, Scaling]) -> dict[str, Scaling]:
    """Scalings whose models, lengths and joint angles have deviations from the posterior, where there is one.

    A length of which a method states no deviation stays without.
    """
    posterior = next((s for s in scalings.values() if s.deviations), None)
    if posterior is None:
        return dict(scalings)
    return {
        name: scaling if scaling.deviations else _state(scaling, posterior)
        for name, scaling in scalings.items()
    }


def _state(scaling: Scaling, posterior: Scaling) -> Scaling:
    pooled: dict[str, list[float]] = {}
    angle_sds: dict[str, dict[str, float]] = {}
    model = scaling.calibration.model
    angles = set(list_joint_angles(model))
    for trial, motion in scaling.motions.items():
        mean, sd = posterior.motions[trial], posterior.deviations[trial]
        for k, name in enumerate(motion.coordinates):
            if name not in mean.coordinates:
                continue
            column = mean.coordinates.index(name)
            square = (motion.q[:, k] - mean.q[:, column]) ** 2 + sd[:, column] ** 2
            known = square[np.isfinite(square) & (square > 0.0)]
            if len(known):
                pooled.setdefault(name, []).append(float(np.mean(known)))
                if name in angles:
                    angle_sds.setdefault(trial, {})[name] = float(np.sqrt(np.mean(known)))
    departures = tuple((name, float(np.sqrt(np.mean(squares)))) for name, squares in pooled.items())
    sizes = dict(scaling.calibration.sizes)
    sized = {size.dimension: size for size in posterior.calibration.sizes.values()}
    for segment, size in sizes.items():
        own, theirs = (s.geometry.lengths.get(size.dimension) for s in (scaling, posterior))
        if own is not None and theirs is not None and size.dimension in sized:
            spread = float(np.hypot(own - theirs, sized[size.dimension].sd * theirs)) / own
            sizes[segment] = replace(size, sd=spread)
    calibration = replace(
        scaling.calibration,
        model=replace(model, departures=departures),
        sizes=sizes,
    )
    return replace(scaling, calibration=calibration, angle_sds=angle_sds)
