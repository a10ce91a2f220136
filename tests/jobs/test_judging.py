"""From results to evidence: what the verdict is told is what was computed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.scaling.comparison.geometry import estimate_usual_lengths
from scaling_service.capabilities.scaling.result import Results, gather_evidence
from scaling_service.model.trial import ImageEvidence


def test_errors_and_parameters_are_the_results(results: Results) -> None:
    found = gather_evidence(results)
    for name, scaling in results.scalings.items():
        method = found.method(name)
        assert method.held_out is not None
        assert method.fitted is not None
        assert (method.held_out.mean, method.held_out.max) == (
            scaling.errors["walk"].mean,
            scaling.errors["walk"].max,
        )
        assert method.fitted.rms == pytest.approx(scaling.errors["hips"].rms, rel=1e-12)
        parameters = scaling.calibration.parameters
        assert method.parameters == len(parameters)
        assert method.undetermined == sum(not p.identifiable for p in parameters)
    assert {m.method for m in found.methods if m.fits_lengths} == {"MB_lam"}
    assert [m.start for m in found.methods] == [None, "MB", "MB"]
    assert set(found.method("MB").hip_centres) == {"hip_r", "hip_l"}


def test_lengths_between_imaged_centres_count_as_imaged(results: Results) -> None:
    assert gather_evidence(results).imaged_lengths == ()
    centres = dict.fromkeys(("hip_r", "hip_l", "knee_r", "ankle_l"), (0.0, 0.0, 0.0))
    session = replace(results.session, images=ImageEvidence(centres=centres))
    seen = replace(results, loaded=replace(results.loaded, session=session))
    assert gather_evidence(seen).imaged_lengths == ("inter_hip", "femur_r")


def test_usual_lengths_are_shares_of_the_height(results: Results) -> None:
    names = results.scalings["MB"].geometry.lengths
    usual = estimate_usual_lengths(2.0, names)
    assert usual == pytest.approx(
        {"femur_r": 0.4908, "femur_l": 0.4908, "shank_r": 0.4712, "shank_l": 0.4712}
    )
    assert estimate_usual_lengths(None, names) == {}


def test_methods_are_apart_by_what_differs(results: Results) -> None:
    """By hand for one pair: the root mean square over frames of the angle that differs most."""
    ((pair, (angle, gap)), *_) = gather_evidence(results).angles_apart.items()
    first, second = (results.scalings[name].motions["walk"] for name in pair)
    column = first.coordinates.index(angle)
    assert gap == pytest.approx(np.sqrt(np.mean((first.q[:, column] - second.q[:, column]) ** 2)))
    others = [
        np.sqrt(np.mean((first.q[:, k] - second.q[:, k]) ** 2))
        for k, name in enumerate(first.coordinates)
        if name.startswith(("hip", "knee"))
    ]
    assert gap == pytest.approx(max(others))
