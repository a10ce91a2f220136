"""The bodies and the engine against OpenSim, and against the laws of momentum."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.blind.bodies import lower_limb, person, whole_body
from tests.blind.body import Array, Body
from tests.blind.engine import Engine, Poses
from tests.blind.motions.motion import Motion
from tests.blind.motions.planted import planted
from tests.blind.osim_file import write_osim
from tests.blind.wobble import accelerations
from tests.peers.worker import ask


@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
@pytest.mark.parametrize("make", [lower_limb, whole_body])
def test_the_written_model_is_the_engines_body(tmp_path: Path, make) -> None:
    rng = np.random.default_rng(3)
    body = make(person(rng))
    write_osim(tmp_path / "model.osim", body)
    engine = Engine(body)
    q, qd = (
        rng.uniform(-0.6, 0.6, (5, len(engine.coordinates))),
        rng.normal(size=(5, len(engine.coordinates))),
    )
    request = {
        "model": str(tmp_path / "model.osim"),
        "coordinates": list(engine.coordinates),
        "markers": list(body.marker_names),
        "q": q.tolist(),
        "qd": qd.tolist(),
    }
    theirs = ask("tests.blind.opensim_poses", request)
    markers = [[frame[name] for name in body.marker_names] for frame in theirs["markers"]]
    np.testing.assert_allclose(
        engine.markers(engine.poses(q)), markers, atol=1e-9
    )  # m: twelve digits in the file
    assert theirs["mass"] == pytest.approx(body.mass, rel=1e-9)
    values, rates = engine.values(q), engine.values(qd) - engine.values(0 * qd)
    energy = [
        pin.computeKineticEnergy(engine.model, engine.data, v, r) for v, r in zip(values, rates, strict=True)
    ]
    np.testing.assert_allclose(energy, theirs["energy"], rtol=1e-8)


def test_the_ground_wrench_obeys_newton_and_euler() -> None:
    rng = np.random.default_rng(0)
    body = whole_body(person(rng))
    motion, _ = planted("gait", "gait", body, rng)
    engine = Engine(body)
    wrench = engine.ground_wrench(motion.q, motion.qd, motion.qdd)
    force, moment = _from_momentum(body, engine.poses(motion.q), motion)
    inner = slice(20, -20)  # splines of positions are less exact at their ends
    np.testing.assert_allclose(
        wrench[inner, :3], force[inner], atol=0.5
    )  # N of 800 N; 2nd derivative of a spline
    np.testing.assert_allclose(wrench[inner, 3:], moment[inner], atol=0.5)


def _from_momentum(body: Body, poses: Poses, motion: Motion) -> tuple[Array, Array]:
    """d/dt of linear and angular momentum about the origin, less gravity's part, without any recursion."""
    gravity = np.array(body.gravity)
    force, moment = np.zeros((len(motion.times), 3)), np.zeros((len(motion.times), 3))
    for k, segment in enumerate(body.segments):
        place = poses.point(segment.name, np.array(segment.com))
        push = segment.mass * (accelerations(motion.times, place) - gravity)
        R = poses.R[:, k]
        rate = np.gradient(R, motion.times, axis=0, edge_order=2)
        spin = np.einsum("nij,nkj->nik", rate, R)  # skew matrix of the angular velocity in ground
        omega = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        inertia = R @ np.array(segment.inertia) @ np.swapaxes(R, 1, 2)
        angular = np.einsum("nij,nj->ni", inertia, omega)
        force += push
        moment += np.cross(place, push) + np.gradient(angular, motion.times, axis=0, edge_order=2)
    return force, moment


@pytest.mark.parametrize("kind", ["standing", "squat", "shift", "bounce", "gait", "hips"])
def test_feet_stay_where_they_are_planned_and_press_under_their_soles(kind: str) -> None:
    rng = np.random.default_rng(11)
    body = whole_body(person(rng))
    motion, pressing = planted(kind, kind, body, rng)
    engine = Engine(body)
    poses = engine.poses(motion.q)
    wrench = engine.ground_wrench(motion.q, motion.qd, motion.qdd)
    weight = body.mass * 9.80665
    assert 0.4 * weight < wrench[:, 1].min()
    assert wrench[:, 1].max() < 1.7 * weight
    assert wrench[:, 1].mean() == pytest.approx(weight, rel=0.03)
    share = np.stack([pressing.right_share, 1 - pressing.right_share], axis=1)
    planned = np.einsum("nk,nka->na", share, pressing.points)
    pressed = np.stack([wrench[:, 5], 0 * wrench[:, 0], -wrench[:, 3]], axis=1) / wrench[:, 1:2]
    assert np.sqrt(np.mean((pressed - planned)[:, [0, 2]] ** 2)) < 0.015  # m: a tenth of a foot's half-length
    if kind in {"standing", "squat", "shift", "bounce"}:
        heel = poses.point("calcn_l", np.array(body.marker("LHEE").at))
        assert np.ptp(heel, axis=0).max() < 0.003  # m
