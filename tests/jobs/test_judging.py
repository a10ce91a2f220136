"""From results to evidence: what the verdict is told is what was computed."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.motion.run import track
from scaling_service.capabilities.scaling.comparison.geometry import estimate_usual_lengths
from scaling_service.capabilities.scaling.result import Results, gather_evidence


def test_errors_and_parameters_are_the_results(results: Results) -> None:
    found = gather_evidence(results)
    methods = {method.method: method for method in found.methods}
    for name, scaling in results.scalings.items():
        method = methods[name]
        assert method.held_out is not None
        assert method.fitted is not None
        assert (method.held_out.mean, method.held_out.max) == (
            scaling.errors["walk"].mean,
            scaling.errors["walk"].max,
        )
        assert method.fitted.mean == pytest.approx(scaling.errors["hips"].mean, rel=1e-12)
        posterior = scaling.calibration.model.posterior
        assert method.skin == (None if posterior is None else posterior.skin)


def test_usual_lengths_are_shares_of_the_height(results: Results) -> None:
    names = results.scalings["MB"].geometry.lengths
    usual = estimate_usual_lengths(2.0, names)
    assert usual == pytest.approx(
        {"femur_r": 0.4908, "femur_l": 0.4908, "shank_r": 0.4712, "shank_l": 0.4712}
    )
    assert estimate_usual_lengths(None, names) == {}


def test_deviations_of_angles_are_those_of_the_trials_held_out(results: Results) -> None:
    """By the posterior: what following each trial states, over its frames; others are farther off."""
    found = {m.method: m for m in gather_evidence(results).methods}
    least = found["MAP"].angle_sds
    for method in found.values():
        assert all(sd >= least[name] for name, sd in method.angle_sds.items())
    model, (walk,) = results.scalings["MAP"].calibration.model, results.session.evaluation
    tracked = track(model, walk)
    column = tracked.motion.coordinates.index("hip_rotation_r")
    by_hand = np.sqrt(np.mean(tracked.uncertainty.sd[:, column] ** 2))
    assert found["MAP"].angle_sds["hip_rotation_r"] == pytest.approx(by_hand)
