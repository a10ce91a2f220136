"""Motion files, with coordinates that follow others."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.motion.saving import write_motion
from scaling_service.files.sto import read_sto
from scaling_service.model.body import BodyModel, Coordinate, Coupler, Joint, Law, Segment, Shape, Term
from scaling_service.model.compile import evaluate_law_at
from scaling_service.model.results import Motion

GLIDE = Law((Term(0.02, coordinate="knee", shape=Shape((0.0, 1.0, 2.0), ((1.0, 0.0), (2.0, 1.0)))),))
FOLLOW = Law.of("knee", 0.5, 0.1)
MODEL = BodyModel(
    name="leg",
    segments=(
        Segment(name="thigh", parent="ground", joint_name="hip", joints=()),
        Segment(
            name="shank",
            parent="thigh",
            joint_name="knee",
            joints=(
                Joint("translation", (1.0, 0.0, 0.0), GLIDE),
                Joint("rotation", (0.0, 0.0, 1.0), Law.of("knee")),
            ),
        ),
    ),
    coordinates=(Coordinate(name="knee"), Coordinate(name="lift", kind="translation")),
    couplers=(
        Coupler("knee_glide", "knee", GLIDE),
        Coupler("patella", "knee", FOLLOW),
        Coupler("crank", "knee", FOLLOW, "rotation"),
    ),
)


def follow_squat(q: np.ndarray, estimated: tuple[str, ...]) -> Motion:
    return Motion(
        trial="squat",
        times=np.arange(len(q)) / 100.0,
        coordinates=("knee", "lift"),
        q=q,
        markers=(),
        residuals=np.zeros((len(q), 0, 3)),
        estimated=estimated,
    )


def test_dependent_coordinates_are_written_in_their_own_unit(tmp_path: Path) -> None:
    q = np.array([[0.5, 0.3], [1.5, 0.4], [np.nan, 0.5]])
    write_motion(tmp_path / "squat_ik.mot", follow_squat(q, ("knee", "lift")), MODEL)
    table = read_sto(tmp_path / "squat_ik.mot")
    assert table.columns == ("time", "knee", "lift", "knee_glide", "patella", "crank")
    assert table.in_degrees is True
    np.testing.assert_allclose(table.column("knee"), np.degrees(q[:, 0]), rtol=1e-11)
    np.testing.assert_allclose(table.column("lift"), q[:, 1], rtol=1e-11)
    np.testing.assert_allclose(table.column("knee_glide")[:2], [0.02 * 0.5, 0.02 * 2.0], rtol=1e-11)
    np.testing.assert_allclose(table.column("patella")[:2], [0.35, 0.85], rtol=1e-11)  # coupled: rad
    np.testing.assert_allclose(table.column("crank")[:2], np.degrees([0.35, 0.85]), rtol=1e-11)
    assert np.isnan(table.data[2, [1, 3, 4, 5]]).all()
    held = read_sto(tmp_path / "squat_ik_opensim.mot")
    assert held.columns == table.columns
    np.testing.assert_array_equal(held.data, table.data[:2])


def test_opensims_tools_read_what_is_never_shown_at_its_neutral_value(tmp_path: Path) -> None:
    q = np.array([[0.5, 0.3], [1.5, 0.4]])
    write_motion(tmp_path / "squat_ik.mot", follow_squat(q, ("knee",)), MODEL)
    assert np.isnan(read_sto(tmp_path / "squat_ik.mot").column("lift")).all()
    held = read_sto(tmp_path / "squat_ik_opensim.mot")
    np.testing.assert_allclose(held.column("lift"), MODEL.coordinate("lift").default)
    np.testing.assert_allclose(held.column("knee"), np.degrees(q[:, 0]), rtol=1e-11)
    if find_spec("opensim") is not None:
        import opensim

        assert opensim.Storage(str(tmp_path / "squat_ik_opensim.mot")).getSize() == 2


def test_a_law_that_needs_more_than_one_coordinate_is_refused() -> None:
    with pytest.raises(ValueError, match="follows another one only"):
        evaluate_law_at(Law((Term(1.0, parameter="scale.femur_r"),)), np.zeros(2))
