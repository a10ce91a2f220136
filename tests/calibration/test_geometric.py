"""Lengths and marker coordinates from a known motion, against a model that is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.consistent.geometric import GeometryPrior, KnownMotion, identify_geometry
from scaling_service.capabilities.consistent.recording import expect_artefacts
from scaling_service.core.errors import TrialUnusable
from scaling_service.model.body import BodyModel, Marker
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import compile_model
from scaling_service.model.scaling import scale_model
from scaling_service.numerics.multibody.tree import pose_markers

RNG = np.random.default_rng(3)
FACTORS = {"shank": 1.06, "thigh": 0.95, "torso": 1.03}


def _moved(marker: Marker) -> tuple[float, float, float]:
    x, y, z = marker.nominal
    dx, dy = 0.01 * RNG.normal(size=2)
    return (x + float(dx), y + float(dy), z)


def _truth() -> BodyModel:
    model = scale_model(load_builtin("squat_4dof"), {name: (f, f, f) for name, f in FACTORS.items()})
    moved = [Marker.at(m.name, m.segment, _moved(m)) if any(m.nominal) else m for m in model.markers]
    return model.with_markers(tuple(moved))


def _known(truth: BodyModel) -> KnownMotion:
    q = np.column_stack([RNG.uniform(-1, 1, 40) for _ in range(4)])
    return KnownMotion("squats", pose_markers(compile_model(truth), q, np.zeros(0)), q)


def test_lengths_and_markers_are_found_again() -> None:
    truth, start = _truth(), load_builtin("squat_4dof")
    found, factors = identify_geometry(
        start, truth.marker_names, [_known(truth)], expect_artefacts(start), bound=0.5, axes="xy"
    )
    for name, factor in FACTORS.items():
        assert factors[name] == pytest.approx(factor, abs=1e-6)
    free = [m for m in truth.markers if any(start.marker(m.name).nominal)]
    for marker in free:
        np.testing.assert_allclose(found.marker(marker.name).nominal, marker.nominal, atol=1e-6)


def test_bounds_hold_and_are_reached() -> None:
    truth, start = _truth(), load_builtin("squat_4dof")
    _, factors = identify_geometry(
        start, truth.marker_names, [_known(truth)], expect_artefacts(start), bound=0.02, axes="xy"
    )
    assert max(abs(f - 1.0) for f in factors.values()) == pytest.approx(0.02, abs=1e-9)


def test_a_prior_holds_where_little_is_seen() -> None:
    truth, start = _truth(), load_builtin("squat_4dof")
    _, factors = identify_geometry(
        start,
        truth.marker_names,
        [_known(truth)],
        expect_artefacts(start),
        bound=0.5,
        axes="xy",
        prior=GeometryPrior(1e-6, 1e-6),
    )
    assert max(abs(f - 1.0) for f in factors.values()) < 1e-5


def test_a_recording_without_markers_is_refused() -> None:
    start = load_builtin("squat_4dof")
    known = _known(_truth())
    empty = replace(known, measured=np.full_like(known.measured, np.nan))
    with pytest.raises(TrialUnusable, match="no marker is seen"):
        identify_geometry(start, start.marker_names, [empty], expect_artefacts(start), bound=0.5, axes="xy")
