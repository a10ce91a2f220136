"""Inverse kinematics by sweeps: the optimum is scipy's, and what must not matter does not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Marker, Segment
from scaling_service.model.compile import compile_model
from scaling_service.numerics.multibody.sweep import SweepSettings, is_articulated, solve_motion
from tests.numerics.bodies import Array
from tests.numerics.swept import SEEDS, Case, case

STRICT = SweepSettings(max_steps=300, left=1e-17, step_tolerance=1e-10)
"""So that angles agree to 1e-7 rad, too: a share of 1e-13 of a cost leaves them 1e-6."""


def assert_as_scipy(this: Case, free: Array | None = None) -> None:
    """The cost of every frame is scipy's, started at the same place."""
    found = this.solve()
    nq = this.truth.shape[1]
    moving = np.ones(nq, dtype=bool) if free is None else free
    low, high = this.options.get("bounds", (np.full(nq, -np.inf), np.full(nq, np.inf)))
    for frame in range(len(this.truth)):

        def rows(x: Array, frame: int = frame) -> Array:
            q = this.start[frame].copy()
            q[moving] = x
            return this.rows(q, frame)

        inside = np.clip(this.start[frame], low + 1e-6, high - 1e-6)[moving]
        peer = least_squares(
            rows,
            inside,
            bounds=(low[moving], high[moving]),
            xtol=1e-14,
            ftol=1e-14,
            gtol=1e-14,
            max_nfev=2000,
        )
        own = rows(found.q[frame][moving])
        assert found.cost[frame] == pytest.approx(own @ own, rel=1e-9, abs=1e-15)
        assert own @ own == pytest.approx(2.0 * peer.cost, rel=1e-8)
        if not np.isinf(low).all():
            assert (found.q[frame] >= low).all()
            assert (found.q[frame] <= high).all()
    assert found.converged.all()


@pytest.mark.parametrize("seed", range(3))
def test_it_finds_what_scipy_finds(seed: int) -> None:
    assert_as_scipy(case(seed))


def test_markers_may_be_missing() -> None:
    this = case(10)
    rng = np.random.default_rng(1)
    gaps = rng.random(this.measured.shape[:2]) < 0.25
    gaps[:, ::4] = False  # one marker of every segment stays
    this.measured[gaps] = np.nan
    assert gaps.any()
    this.options["prior"] = (this.truth, np.full(this.truth.shape[1], 1e-3))
    assert_as_scipy(this)


def test_weights_may_change_with_time() -> None:
    this = case(11)
    varying = np.random.default_rng(2).uniform(0.0, 2.0, this.measured.shape[:2])
    varied = Case(this.model, this.truth, this.start, this.measured, varying, {})
    assert_as_scipy(varied)
    assert np.abs(varied.solve().q - this.solve().q).max() > 1e-4


@pytest.mark.parametrize("seed", range(20, 26))
def test_bounds_hold(seed: int) -> None:
    this = case(seed, n=4)
    low, high = np.full(10, -np.inf), np.full(10, np.inf)
    low[9], high[9] = -0.9, -0.6  # the knee swings beyond both
    low[6], high[7] = 0.3, 0.1
    this.options["bounds"] = (low, high)
    assert_as_scipy(this)
    assert (this.solve().q[:, 9] == np.clip(this.solve().q[:, 9], -0.9, -0.6)).all()


def test_priors_pull() -> None:
    this = case(12)
    pull = np.zeros(10)
    pull[[6, 9]] = 0.02, 0.05
    this.options["prior"] = (np.zeros_like(this.truth), pull)
    assert_as_scipy(this)
    assert np.abs(this.solve().q[:, 9]).mean() < np.abs(case(12).solve().q[:, 9]).mean()


def test_locked_coordinates_stay() -> None:
    this = case(13)
    free = np.ones(10, dtype=bool)
    free[[4, 9]] = False
    this.options["free"] = free
    assert_as_scipy(this, free)
    np.testing.assert_array_equal(this.solve().q[:, [4, 9]], this.start[:, [4, 9]])


def test_a_batch_of_four_equals_four_single_calls() -> None:
    this = case(15, n=4)
    together = this.solve()
    for k in range(4):
        one = Case(this.model, this.truth, this.start[k : k + 1], this.measured[k : k + 1], this.weights, {})
        np.testing.assert_allclose(one.solve().q[0], together.q[k], rtol=0, atol=1e-12)


def test_blocks_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    this = case(16, n=600)
    this.measured[255:258, 2] = np.nan
    varying = np.broadcast_to(this.weights, this.measured.shape[:2]).copy()
    this = Case(this.model, this.truth, this.start, this.measured, varying, {})
    this.options["prior"] = (this.truth, np.full(10, 1e-4))
    few = SweepSettings(max_steps=4, left=0.0, step_tolerance=0.0)  # so that both end alike
    blocked = this.solve(few)
    monkeypatch.setattr("scaling_service.numerics.multibody.sweep._BLOCK", 10_000)
    np.testing.assert_allclose(blocked.q, this.solve(few).q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(blocked.cost, this.solve(few).cost, rtol=1e-11)


def test_progress_counts_frames() -> None:
    this, reported = case(16, n=600), []
    this.options["progress"] = reported.append
    this.solve()
    assert reported == [256, 512, 600]


@settings(max_examples=10)
@given(seed=SEEDS)
def test_moving_the_ground_changes_the_root_only(seed: int) -> None:
    this = case(17, n=3)
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(random_state=rng), rng.uniform(-5.0, 5.0, 3)
    moved = turn.apply(this.measured.reshape(-1, 3)).reshape(this.measured.shape) + shift
    about = turn.as_matrix() @ Rotation.from_euler("YXZ", this.start[:, 3:6]).as_matrix()
    start = this.start.copy()
    start[:, :3] = turn.apply(this.start[:, :3]) + shift
    start[:, 3:6] = Rotation.from_matrix(about).as_euler("YXZ")
    if np.abs(np.cos(start[:, 4])).min() < 0.2:
        return  # near the singularity of the root's angles
    there = Case(this.model, this.truth, start, moved, this.weights, {})
    here, there = this.solve(STRICT), there.solve(STRICT)
    np.testing.assert_allclose(there.cost, here.cost, rtol=1e-8)
    np.testing.assert_allclose(there.q[:, 6:], here.q[:, 6:], rtol=0, atol=1e-6)


def test_a_frame_without_markers_stays_at_its_start() -> None:
    this = case(18)
    this.measured[2] = np.nan
    found = this.solve()
    np.testing.assert_array_equal(found.q[2], this.start[2])
    assert found.cost[2] == 0.0
    assert found.converged.all()
    assert np.isfinite(found.q).all()


def test_a_coordinate_that_no_marker_sees_stays_at_its_start() -> None:
    this = case(19)
    tibia = [k for k, m in enumerate(this.model.markers) if m.segment == "tibia"]
    this.measured[:, tibia] = np.nan
    found = this.solve()
    np.testing.assert_array_equal(found.q[:, 9], this.start[:, 9])


def test_far_from_the_origin_it_is_as_exact() -> None:
    this = case(31)
    far = np.array([1e3, -2e3, 5e2])
    start = this.start.copy()
    start[:, :3] += far
    moved = Case(this.model, this.truth, start, this.measured + far, this.weights, {}).solve()
    np.testing.assert_allclose(moved.cost, this.solve().cost, rtol=1e-8)


def test_a_coordinate_in_two_links_is_refused() -> None:
    shared = Joint("rotation", (0.0, 0.0, 1.0), Law.of("a"))
    segments = (
        Segment(name="one", parent="ground", joint_name="j", joints=(shared,)),
        Segment(name="two", parent="one", joint_name="k", joints=(shared,)),
    )
    model = BodyModel(name="shared", segments=segments, coordinates=(Coordinate(name="a"),))
    model = model.with_markers(tuple(_markers("one", "two")))
    tree = compile_model(model)
    assert not is_articulated(tree)
    with pytest.raises(ValueError, match="several links"):
        solve_motion(tree, np.zeros((1, 2, 3)), np.ones(2), np.zeros((1, 1)), np.zeros(0))


def _markers(*segments: str) -> list[Marker]:
    return [Marker.at(f"m_{name}", name, (0.1, 0.0, 0.0)) for name in segments]
