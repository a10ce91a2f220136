"""What is told of a calibration's geometry."""

from __future__ import annotations

import pytest

from scaling_service.capabilities.scaling.comparison.geometry import measure_geometry, measure_marker_shifts
from scaling_service.model.builtin import load_builtin
from scaling_service.model.results import Calibration, EstimatedParameter
from scaling_service.model.scaling import scale_model


def fitted(name: str, value: float, group: str, target: str) -> EstimatedParameter:
    return EstimatedParameter(
        name=name,
        value=value,
        unit="m",
        sd=0.001,
        at_bound=False,
        identifiable=True,
        group=group,
        target=target,
    )


def test_geometry_of_a_scaled_built_in_model() -> None:
    generic = load_builtin("lower_limb_14dof")
    factors = {"pelvis": (1.1,) * 3, "femur_r": (0.9,) * 3}
    model = scale_model(generic, factors)
    found = measure_geometry(
        Calibration(
            method="MB",
            model=model,
            generic=generic,
            scale_factors=factors,
            axis_tilts={"knee_r": (0.01, -0.02)},
        )
    )
    # Lengths of the generic model: Puchaud 2019, table 2.
    assert found.lengths["inter_hip"] == pytest.approx(1.1 * 0.1735)
    assert found.lengths["femur_r"] == pytest.approx(0.9 * 0.43245)
    assert found.lengths["femur_l"] == pytest.approx(0.43245)
    assert found.joint_centres["knee_r"] == ("femur_r", pytest.approx((0.0, -0.9 * 0.43245, 0.0)))
    assert found.knee_axes == {"r": (0.01, -0.02)}


@pytest.mark.parametrize(
    ("joint", "side"), [("knee_l", "l"), ("walker_knee_r", "r"), ("knee_angle", "knee_angle")]
)
def test_knee_axes_are_named_by_side(joint: str, side: str) -> None:
    generic = load_builtin("lower_limb_14dof")
    assert list(
        measure_geometry(
            Calibration(
                method="MB", model=generic, generic=generic, scale_factors={}, axis_tilts={joint: (0.0, 0.0)}
            )
        ).knee_axes
    ) == [side]


def test_marker_shift_is_the_length_of_what_was_fitted() -> None:
    generic = load_builtin("lower_limb_14dof")
    parameters = (
        fitted("marker.RASIS.x", 0.002, "marker", "RASIS"),
        fitted("marker.RASIS.y", -0.003, "marker", "RASIS"),
        fitted("marker.RASIS.z", 0.006, "marker", "RASIS"),
        fitted("scale.pelvis", 1.1, "length", "pelvis"),
    )
    shifts = measure_marker_shifts(
        Calibration(method="MB_am", model=generic, generic=generic, scale_factors={}, parameters=parameters)
    )
    assert shifts.pop("RASIS") == pytest.approx(0.007)
    assert set(shifts.values()) == {0.0}
    assert "RAJC" not in shifts  # a landmark of the model, no marker
