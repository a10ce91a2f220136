"""Kinematic error against distances written down by hand, and what must not change it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from scaling_service.capabilities.motion.kinematic_error import kinematic_error
from scaling_service.model.body import BodyModel, Marker, Segment
from scaling_service.model.results import Motion

NAMES = ("RASIS", "CLUSTER", "BONE")
MODEL = BodyModel(
    name="box",
    segments=(Segment(name="box", parent="ground", joint_name="free", joints=()),),
    coordinates=(),
    markers=(
        Marker.at("RASIS", "box", (0.0, 0.0, 0.0), anatomical=False),
        Marker.at("CLUSTER", "box", (0.0, 0.0, 0.0), anatomical=False),
        Marker.at("BONE", "box", (0.0, 0.0, 0.0), anatomical=True),
    ),
)
NAN = np.full(3, np.nan)


def motion(gaps: np.ndarray) -> Motion:
    n = len(gaps)
    return Motion(
        trial="walk",
        times=np.arange(n) / 100.0,
        coordinates=(),
        q=np.zeros((n, 0)),
        markers=NAMES[: gaps.shape[1]],
        residuals=gaps,
        estimated=(),
    )


def test_known_distances() -> None:
    gaps = np.array(
        [
            [[0.003, 0.004, 0.0], [0.0, 0.0, 0.010], NAN],  # 5 and 10 mm: mean 7.5
            [[0.0, 0.013, 0.0], NAN, NAN],  # 13 mm
            [NAN, NAN, NAN],
        ]
    )
    error = kinematic_error(motion(gaps), MODEL)
    assert error.mean == pytest.approx((5 + 10 + 13) / 3e3)
    assert error.sd == pytest.approx((13 - 7.5) / 2e3)
    assert error.rms == pytest.approx(math.sqrt((25 + 100 + 169) / 3) / 1e3)
    assert error.max == pytest.approx(0.013)
    assert error.per_marker == pytest.approx({"RASIS": 0.009, "CLUSTER": 0.010})
    assert error.n_frames == 2


def test_landmarks_and_tracking_markers_apart() -> None:
    # RASIS is a landmark by its name, BONE because the model says so.
    gaps = np.zeros((1, 3, 3))
    gaps[0, :, 0] = (0.002, 0.010, 0.004)
    error = kinematic_error(motion(gaps), MODEL)
    assert error.anatomical_mean == pytest.approx(0.003)
    assert error.tracking_mean == pytest.approx(0.010)


def test_no_tracking_marker_has_no_mean() -> None:
    assert math.isnan(kinematic_error(motion(np.zeros((2, 1, 3))), MODEL).tracking_mean)


_GAPS = arrays(np.float64, (6, 3, 3), elements=st.floats(-0.05, 0.05))


@given(gaps=_GAPS, seen=arrays(np.bool_, (6, 3)))
def test_mean_rms_and_maximum_are_in_order(gaps: np.ndarray, seen: np.ndarray) -> None:
    seen[0, 0] = True
    error = kinematic_error(motion(np.where(seen[..., None], gaps, np.nan)), MODEL)
    slack = 1e-12  # m: rounding of sums of a few hundredths
    assert error.mean <= error.rms + slack
    assert error.rms <= error.max + slack
    assert error.n_frames == int(seen.any(axis=1).sum())


@given(gaps=_GAPS, order=st.permutations(range(6)))
def test_the_order_of_frames_does_not_matter(gaps: np.ndarray, order: list[int]) -> None:
    first, second = kinematic_error(motion(gaps), MODEL), kinematic_error(motion(gaps[order]), MODEL)
    assert second.mean == pytest.approx(first.mean, abs=1e-15)
    assert second.sd == pytest.approx(first.sd, abs=1e-12)
    assert second.per_marker == pytest.approx(first.per_marker, abs=1e-15)


@given(gaps=_GAPS)
def test_a_frame_without_markers_changes_nothing(gaps: np.ndarray) -> None:
    longer = np.concatenate([gaps, np.full((1, 3, 3), np.nan)])
    assert kinematic_error(motion(longer), MODEL) == kinematic_error(motion(gaps), MODEL)
