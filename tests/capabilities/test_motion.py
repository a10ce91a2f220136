"""Following recordings: how sure the coordinates are, and where the segments are."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scaling_service.capabilities.motion.result import make_trial_document
from scaling_service.capabilities.motion.run import track
from scaling_service.capabilities.motion.saving import tabulate_poses
from scaling_service.capabilities.motion.stops import describe_stops
from scaling_service.files.osim.models import write_osim
from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Marker, Segment
from scaling_service.model.results import Motion
from tests.capabilities.recorded import recorded
from tests.peers.worker import ask

NOMINAL = 1.959964  # of the normal distribution, 95 %


@pytest.mark.parametrize("name", ["lower_limb_14dof", "full_body_35dof"])
@pytest.mark.parametrize("uneven", [False, True])
def test_intervals_of_95_percent_cover_the_truth(name: str, uneven: bool) -> None:
    made = recorded(name, 400, 3, uneven=uneven)
    tracked = track(made.model, made.trial, skin=False)
    sd = tracked.uncertainty.sd
    free = [k for k, c in enumerate(made.model.coordinates) if not c.locked]
    off = (tracked.motion.q - made.q)[:, free]
    assert np.isfinite(sd[:, free]).all()
    assert 0.93 < np.mean(np.abs(off) < NOMINAL * sd[:, free]) < 0.97
    reported, true = np.log(tracked.uncertainty.noise), np.log(made.noise)
    assert np.median(np.abs(reported - true)) < 0.1
    assert not uneven or np.corrcoef(reported, true)[0, 1] > 0.9


def test_one_marker_that_is_ten_times_worse_is_told_apart() -> None:
    made = recorded("full_body_35dof", 300, 5)
    markers = made.trial.markers.copy()
    worse = made.trial.labels.index("RLFE")
    markers[:, worse] += np.random.default_rng(1).normal(size=(300, 3)) * 20e-3
    noise = track(made.model, replace(made.trial, markers=markers)).uncertainty.noise
    assert noise[worse] == pytest.approx(20e-3, rel=0.2)
    assert np.median(noise) == pytest.approx(2e-3, rel=0.2)


def test_a_frame_by_itself_and_all_frames_give_what_a_closed_form_gives() -> None:
    """A box of four markers that only shifts: each coordinate is their mean, so its sd is noise / 2."""
    model = _box(locked=False)
    rng = np.random.default_rng(2)
    corners = np.array([[0.1, 0, 0], [-0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    places = corners + rng.normal(0.0, 3e-3, (500, 4, 3))
    trial = recorded("squat_4dof", 500, 0).trial
    trial = replace(trial, labels=("A", "B", "C", "D"), markers=places)
    tracked = track(model, trial, skin=False)
    assert tracked.motion.q == pytest.approx((places - corners).mean(axis=1), abs=1e-9)
    assert tracked.uncertainty.sd == pytest.approx(np.full((500, 3), 1.5e-3), rel=0.05)


def test_locked_coordinates_are_certain_and_those_at_the_end_of_their_range_are_not_reported() -> None:
    trial = recorded("squat_4dof", 60, 0).trial
    places = np.random.default_rng(4).normal(0.0, 1e-3, (60, 4, 3))
    places[30:, :, 0] += 1.0  # beyond the range
    places += np.array([[0.1, 0, 0], [-0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    trial = replace(trial, labels=("A", "B", "C", "D"), markers=places)
    tracked = track(_box(locked=True), trial)
    assert (tracked.uncertainty.sd[:, 2] == 0.0).all()
    assert np.isnan(tracked.uncertainty.sd[30:, 0]).all()
    assert np.isfinite(tracked.uncertainty.sd[:30, 0]).all()
    assert make_trial_document(tracked, _box(locked=True)).frames_at_range_end == {"tx": 30}
    assert describe_stops(_box(locked=True), {"squat": tracked.motion}) == [
        "squat: tx stands at its stop, 0.600 m, for 50% of the recording: there the model's range decides, "
        "not the markers"
    ]
    brief = replace(tracked.motion, q=tracked.motion.q[:32])  # 2 of 32 frames
    assert describe_stops(_box(locked=True), {"squat": brief}) == []


def _box(*, locked: bool) -> BodyModel:
    names = ("tx", "ty", "tz")
    joints = tuple(
        Joint("translation", axis, Law.of(name))
        for name, axis in zip(names, ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)), strict=True)
    )
    corners = {"A": (0.1, 0.0, 0.0), "B": (-0.1, 0.0, 0.0), "C": (0.0, 0.1, 0.0), "D": (0.0, 0.0, 0.1)}
    return BodyModel(
        name="box",
        segments=(Segment(name="box", parent="ground", joint_name="slide", joints=joints),),
        coordinates=tuple(
            Coordinate(
                name=n,
                kind="translation",
                lower=-0.6,
                upper=0.6,
                clamped=n == "tx",
                locked=locked and n == "tz",
            )
            for n in names
        ),
        markers=tuple(Marker.at(name, "box", place) for name, place in corners.items()),
    )


def test_what_markers_do_not_determine_has_no_standard_deviation() -> None:
    made = recorded("lower_limb_14dof", 120, 6)
    shank = [k for k, n in enumerate(made.trial.labels) if made.model.marker(n).segment == "tibia_r"]
    markers = made.trial.markers.copy()
    markers[40:80, shank] = np.nan
    tracked = track(made.model, replace(made.trial, markers=markers))
    knee = tracked.motion.coordinates.index("knee_angle_r")
    assert np.isnan(tracked.uncertainty.sd[40:80, knee]).all()
    assert np.isfinite(tracked.uncertainty.sd[:40, knee]).all()
    left = tracked.motion.coordinates.index("knee_angle_l")
    assert np.isfinite(tracked.uncertainty.sd[:, left]).all()
    assert make_trial_document(tracked, made.model).frames_not_determined["knee_angle_r"] == 40
    origins, _ = _poses(made.model, tracked.motion)
    assert np.isnan(origins[40:80, made.model.segment_names.index("tibia_r")]).all()
    assert np.isfinite(origins[:, made.model.segment_names.index("tibia_l")]).all()


def test_poses_of_a_chain_in_closed_form() -> None:
    """A turn about X, then Y, then Z carries a segment: the angles are the coordinates."""
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    names = ("x", "y", "z")
    turns = tuple(Joint("rotation", a, Law.of(n)) for a, n in zip(axes, names, strict=True))
    shifted = (Joint("translation", (0.0, 1.0, 0.0), Law.constant(0.4)), *turns)
    model = BodyModel(
        name="chain",
        segments=(
            Segment(name="first", parent="ground", joint_name="root", joints=turns),
            Segment(name="second", parent="first", joint_name="next", joints=shifted),
        ),
        coordinates=tuple(Coordinate(name=n) for n in names),
    )
    q = np.random.default_rng(0).uniform(-1.2, 1.2, (50, 3))
    origins, angles = _poses(model, _motion(names, q))
    assert angles[:, 0] == pytest.approx(q, abs=1e-12)
    assert origins[:, 0] == pytest.approx(np.zeros((50, 3)))
    turned = Rotation.from_euler("XYZ", q)
    assert origins[:, 1] == pytest.approx(turned.apply([0.0, 0.4, 0.0]), abs=1e-12)
    assert angles[:, 1] == pytest.approx((turned * turned).as_euler("XYZ"), abs=1e-9)


@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
def test_poses_are_those_of_opensim(tmp_path: Path) -> None:
    made = recorded("full_body_35dof", 12, 8)
    write_osim(tmp_path / "body.osim", made.model)
    request = {"model": str(tmp_path / "body.osim"), "coordinates": made.model.coordinate_names}
    answer = ask("tests.peers.opensim_bodies", request | {"q": made.q.tolist()})
    origins, angles = _poses(made.model, _motion(made.model.coordinate_names, made.q))
    for k, segment in enumerate(made.model.segment_names):
        assert origins[:, k] == pytest.approx(np.array(answer["origins"][segment]), abs=1e-8)
        assert angles[:, k] == pytest.approx(np.array(answer["angles"][segment]), abs=1e-7)


def _poses(model: BodyModel, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Origins, m, and body-fixed angles, rad, each (n_frames, n_segments, 3)."""
    both = tabulate_poses(motion, model).data[:, 1:].reshape(len(motion.times), -1, 6)
    return both[..., :3], np.radians(both[..., 3:])


def _motion(names: tuple[str, ...], q: np.ndarray) -> Motion:
    return Motion(
        trial="w",
        times=np.arange(len(q)) / 100.0,
        coordinates=names,
        q=q,
        markers=(),
        residuals=np.zeros((len(q), 0, 3)),
        estimated=names,
    )
