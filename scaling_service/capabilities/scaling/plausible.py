"""What makes scaled models doubtful though nothing failed: said, not decided."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from scaling_service.capabilities.motion.kinematic_error import KinematicError

FOLLOWED_M = 0.04
"""Mean distance between measured and model markers beyond which something is mixed up (OpenSim 4
documentation, "Getting Started with Inverse Kinematics": even the largest should stay below 2 to 4 cm)."""

SHARE_OF_STATURE = {"femur": 0.2454, "shank": 0.2356}
"""Between joint centres, mean of 26 persons (Puchaud 2019, table 2, over their mean stature of 1.762 m)."""

SPREAD = 0.2
"""Chosen: about four standard deviations of those shares over persons (5.3 % and 5.5 %, same source)."""


def doubts(
    errors: Mapping[str, Mapping[str, KinematicError]],
    lengths: Mapping[str, Mapping[str, float]],
    height_m: float | None,
) -> tuple[str, ...]:
    """What a reader should look at before believing any number.

    ``errors``, ``lengths``: method to trial to error, and method to length (``femur_r`` …) to m.
    Returns one plain sentence each.
    """
    return (*_lost(errors), *(() if height_m is None else _sizes(lengths, height_m)))


def _lost(errors: Mapping[str, Mapping[str, KinematicError]]) -> Iterator[str]:
    trials = dict.fromkeys(trial for by_trial in errors.values() for trial in by_trial)
    for trial in trials:
        best = min(by_trial[trial].mean for by_trial in errors.values() if trial in by_trial)
        if best > FOLLOWED_M:
            yield (
                f"no model follows the markers of '{trial}' better than {1e3 * best:.0f} mm on average: "
                f"check its labels and unit, and that all recordings are of one person"
            )


def _sizes(lengths: Mapping[str, Mapping[str, float]], height_m: float) -> Iterator[str]:
    for name in dict.fromkeys(name for found in lengths.values() for name in found):
        usual = height_m * SHARE_OF_STATURE.get(name.rpartition("_")[0], float("nan"))
        odd = [
            f"{1e3 * found[name]:.0f} mm ({method})"
            for method, found in lengths.items()
            if name in found and abs(found[name] - usual) > SPREAD * usual
        ]
        if odd:
            yield (
                f"{name} of {', '.join(odd)} is unusual for a height of {height_m:.2f} m "
                f"({1e3 * usual:.0f} mm on average): check the height, the unit and the labels"
            )
