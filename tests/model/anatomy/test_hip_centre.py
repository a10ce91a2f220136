"""Hip centre regressions: worked by hand, unmoved by rigid motions, mirrored."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scaling_service.core.errors import InputError
from scaling_service.model.anatomy.hip_centre import HIP_REGRESSIONS, predict_hip_centres
from scaling_service.model.builtin import load_builtin
from tests.model.anatomy.clinic_files import clinic_trials

# width 240 mm, depth 160 mm
PELVIS = np.array([[0.0, 1.0, 0.12], [0.0, 1.0, -0.12], [-0.16, 1.0, 0.04], [-0.16, 1.0, -0.04]])[:, None]


@pytest.mark.parametrize(
    ("regression", "legs", "expected_mm"),
    [
        ("harrington2007", {}, (-48.3, -82.9, 86.5)),  # -.24 160 - 9.9, -.30 240 - 10.9, .33 240 + 7.3
        ("harrington2007", {"leg_length_r": 0.9}, (-48.3, -82.9, 86.5)),
        ("harrington2007_single", {"leg_length_r": 0.9}, (-48.3, -82.9, 86.5)),
        (
            "harrington2007_multi",
            {"leg_length_r": 0.9},
            (-48.3, -81.5, 91.1),
        ),  # -.16 240 - .04 900 - 7.1, .28 160 + .16 240 + 7.9
        ("bell1990", {}, (-45.6, -72.0, 86.4)),
        ("hara2016", {"leg_length_l": 0.9}, (-45.7, -79.2, 85.4)),
    ],
)
def test_worked_by_hand(regression: str, legs: dict[str, float], expected_mm: tuple[float, ...]) -> None:
    found = predict_hip_centres(*PELVIS, regression=regression, **legs)
    np.testing.assert_allclose(1000 * found.right[0], expected_mm, atol=1e-9)
    np.testing.assert_allclose(found.left, found.right * [1, 1, -1], atol=1e-12)
    np.testing.assert_allclose(found.right_ground, found.right + np.array([0, 1, 0]), atol=1e-12)


def test_the_conventional_model_worked_by_hand() -> None:
    legs = {"leg_length_r": 0.9, "leg_length_l": 0.9}
    found = predict_hip_centres(*PELVIS, regression="plug_in_gait", width=0.25, marker_radius=0.007, **legs)
    # C = 88.2, ASIS 67.36 + 7 before the hip: 88.2 cos .5 sin .314 - 74.36 cos .314, ..., 125 - 88.2 sin .5
    np.testing.assert_allclose(1000 * found.right[0], (-46.817, -96.585, 82.715), atol=1e-3)
    davis = predict_hip_centres(*PELVIS, regression="davis1991", width=0.25, marker_radius=0.007, **legs)
    assert 0.0001 < np.linalg.norm(davis.right - found.right) < 0.001  # other angles


def test_the_hip_centres_of_a_laboratory(shared_data: Path) -> None:
    """Its tables have Davis' angles; its knees come from Plug-in Gait's (test_conventional)."""
    for stem, lab in clinic_trials(shared_data).items():
        found = predict_hip_centres(
            *(lab.marker(label) for label in ("RASI", "LASI", "SACR", "SACR")),
            regression="davis1991",
            leg_length_r=lab.sizes["RLegLength"],
            leg_length_l=lab.sizes["LLegLength"],
            width=lab.sizes["InterAsisDistance"],
            marker_radius=lab.sizes["MarkerDiameter"] / 2,
        )
        for ours, label in ((found.right_ground, "RHJC"), (found.left_ground, "LHJC")):
            assert np.nanmax(np.abs(ours - lab.centre(label))) < 1e-5, f"{stem} {label}"  # m


def test_each_side_uses_its_own_leg() -> None:
    found = predict_hip_centres(
        *PELVIS, regression="harrington2007_multi", leg_length_r=0.9, leg_length_l=0.95
    )
    assert 1000 * (found.right - found.left)[0, 1] == pytest.approx(0.04 * 50)


@pytest.mark.parametrize("regression", HIP_REGRESSIONS)
def test_rigid_motion_moves_the_centres_along(regression: str) -> None:
    rng = np.random.default_rng(0)
    turns, shift = Rotation.random(7, random_state=1), rng.normal(size=(7, 3))
    moved = [turns.apply(m) + shift for m in PELVIS]
    still = predict_hip_centres(*PELVIS, regression=regression, leg_length_r=0.9)
    found = predict_hip_centres(*moved, regression=regression, leg_length_r=0.9)
    np.testing.assert_allclose(found.right, np.repeat(still.right, 7, axis=0), atol=1e-12)
    np.testing.assert_allclose(found.left_ground, turns.apply(still.left_ground[0]) + shift, atol=1e-12)


def test_a_missing_marker_costs_its_frame_only() -> None:
    markers = np.repeat(PELVIS, 3, axis=1)
    markers[2, 1] = np.nan
    found = predict_hip_centres(*markers)
    for centres in (found.right, found.left, found.right_ground, found.left_ground):
        assert np.isnan(centres[1]).all()
        assert np.isfinite(centres[[0, 2]]).all()


def test_the_generic_model_agrees_with_its_own_regression() -> None:
    """The built-in hip centre is Harrington's for its own pelvis markers, up to rounding."""
    model = load_builtin("lower_limb_14dof")
    markers = [np.array([model.marker(name).nominal]) for name in ("RASIS", "LASIS", "RPSIS", "LPSIS")]
    centre = [joint.law.constant_part for joint in model.segment("femur_r").joints[:3]]
    np.testing.assert_allclose(predict_hip_centres(*markers).right[0], centre, atol=1e-4)


def test_refusals() -> None:
    with pytest.raises(InputError, match="leg length"):
        predict_hip_centres(*PELVIS, regression="hara2016")
    with pytest.raises(InputError, match="bell1990"):
        predict_hip_centres(*PELVIS, regression="crystal ball")
