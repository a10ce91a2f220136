"""Inverse dynamics of motions whose truth is known, of real recordings, and beside OpenSim's."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from scaling_service.capabilities.dynamics.weight import weigh_motions
from scaling_service.capabilities.kinetics.inverse_dynamics import (
    InverseDynamics,
    RatedMotion,
    compute_dynamics,
    differentiate_motion,
    solve_inverse_dynamics,
)
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError, ModelRefused, TrialUnusable
from scaling_service.files.forces import read_forces
from scaling_service.files.osim.models import read_osim
from scaling_service.files.sto import Table, tabulate_motion, write_sto
from scaling_service.files.trc import read_trc
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.inertia import compile_mechanism, sum_mass
from scaling_service.model.results import Motion
from scaling_service.numerics.multibody.motion import Motion as Rates
from scaling_service.numerics.multibody.tree import place_tree_markers, pose_links
from scaling_service.numerics.signals.splines import differentiate_spline
from scaling_service.numerics.wrench import GRAVITY, compute_root_wrench
from scaling_service.recording.plates import synchronise
from scaling_service.recording.plates_feet import assign_foot_loads, assign_plates
from tests.peers.opensim_id import OpenSimId, run_opensim_id, write_loads

BODY = load_builtin("full_body_35dof")
TIMES = np.arange(200) / 100


def swaying() -> tuple[Array, Array, Array]:
    """A slow whole-body motion with its true rates, (200, 35) each."""
    rng = np.random.default_rng(0)
    size, pace, phase = rng.uniform(0.05, 0.3, (3, 35)) * [[1], [12], [9]]
    at = np.outer(TIMES, pace) + phase
    return size * np.sin(at), size * pace * np.cos(at), -size * pace**2 * np.sin(at)


def motion_of(q: Array, coordinates: tuple[str, ...] = BODY.coordinate_names) -> Motion:
    return Motion(
        trial="sway",
        times=TIMES,
        coordinates=coordinates,
        q=q,
        markers=(),
        residuals=np.zeros((len(q), 0, 3)),
        estimated=coordinates,
    )


def bearing(share: float = 0.5) -> SegmentLoads:
    """Two feet that bear exactly what the true motion needs."""
    wrench, _ = compute_root_wrench(compile_mechanism(BODY), Rates.of_frames(*swaying()), np.zeros(0))
    parts = np.stack([share * wrench.T, (1 - share) * wrench.T], axis=1)
    return SegmentLoads(TIMES, ("calcn_r", "calcn_l"), parts[..., :3], parts[..., 3:])


def test_a_true_motion_with_true_loads_leaves_no_residual() -> None:
    rated = differentiate_motion(BODY, TIMES, swaying()[0], cutoff_hz=None)
    inner = slice(15, -15)  # the natural spline settles within some samples of the ends
    np.testing.assert_allclose(rated.qddot[inner], swaying()[2][inner], rtol=0, atol=1e-4)
    found = compute_dynamics(BODY, rated, bearing())
    np.testing.assert_allclose(found.residual[inner], 0.0, atol=1e-3)
    np.testing.assert_allclose(found.external[:, 1].mean() / 9.80665, found.mass, rtol=0.05)


def test_order_of_the_coordinates_and_whole_turns_do_not_matter() -> None:
    q = swaying()[0]
    plain = solve_inverse_dynamics(BODY, motion_of(q), bearing())
    names = BODY.coordinate_names
    turned = q.copy()
    turned[100:, names.index("pelvis_rotation")] += 2 * np.pi
    other = solve_inverse_dynamics(BODY, motion_of(turned[:, ::-1], names[::-1]), bearing())
    np.testing.assert_allclose(other.residual, plain.residual, atol=1e-8)
    np.testing.assert_allclose(other.forces, plain.forces, atol=1e-8)


def test_one_missing_frame_spoils_one_frame() -> None:
    q, loads = swaying()[0], bearing()
    q[150, 4] = np.nan
    force = loads.force.copy()
    force[40, 1, 0] = np.nan
    found = solve_inverse_dynamics(BODY, motion_of(q), replace(loads, force=force))
    assert np.flatnonzero(~found.known).tolist() == [40, 150]


def test_the_centre_of_mass_is_the_weighted_mean() -> None:
    still = np.tile([c.default for c in BODY.coordinates], (200, 1))
    found = solve_inverse_dynamics(BODY, motion_of(still))
    assert 0.53 < found.centre_of_mass[0, 1] / 1.762 < 0.59  # of the stature; Winter 2009: about .56
    weight = found.mass * 9.80665
    np.testing.assert_allclose(found.residual[:, 1], weight, rtol=1e-9)
    arm = (found.centre_of_mass - found.root)[:, 0]
    np.testing.assert_allclose(found.residual[:, 5], arm * weight, rtol=1e-9)


def test_what_cannot_be_is_refused() -> None:
    q, loads = swaying()[0], bearing()
    with pytest.raises(TrialUnusable, match="the motion has no coordinate 'pelvis_tx'"):
        solve_inverse_dynamics(BODY, motion_of(q[:, 1:], BODY.coordinate_names[1:]), loads)
    with pytest.raises(TrialUnusable, match="not on one clock"):
        solve_inverse_dynamics(BODY, motion_of(q), replace(loads, times=TIMES + 0.004))
    with pytest.raises(InputError, match="acts on 'paw', which is no segment"):
        solve_inverse_dynamics(BODY, motion_of(q), replace(loads, segments=("paw", "calcn_l")))
    with pytest.raises(InputError, match="does not suit 100 frames per second"):
        solve_inverse_dynamics(BODY, motion_of(q), loads, cutoff_hz=60.0)
    weightless = replace(BODY, segments=tuple(replace(s, mass=0.0) for s in BODY.segments))
    with pytest.raises(ModelRefused, match="no segment of model 'full_body_35dof' has mass"):
        solve_inverse_dynamics(weightless, motion_of(q), loads)


# --- real recordings, beside OpenSim --------------------------------------------------------------

RECORDINGS = {
    "gait2354": (
        "gait2354_simbody.osim",
        "gait2354_Scale_MarkerSet.xml",
        "subject01_walk1.trc",
        "subject01_walk1_grf.mot",
        ("R.Heel", "R.Toe.Tip"),
    ),
    "opencap_squat": (
        "manually_scaled.osim",
        None,
        "squats1.trc",
        "squats1_grf.mot",
        ("r_calc", "r_toe"),
    ),
}
FRAMES = 150


def recorded(data: Path, name: str) -> tuple[Path, BodyModel, InverseDynamics, SegmentLoads]:
    """A recording's dynamics at 6 Hz, and the loads, on an exactly regular clock."""
    file, markers, trc, grf, right = RECORDINGS[name]
    folder = data / name
    model = read_osim(folder / file, folder / markers if markers else None)
    trial = read_trc(folder / trc).frames(slice(0, FRAMES))
    motion = inverse_kinematics(model, trial)
    feet = {
        f"calcn_{side}": np.stack([trial.position(f"{letter}{label[1:]}") for label in right], axis=1)
        for side, letter in (("r", right[0][0]), ("l", "L"))
    }
    forces = synchronise(read_forces(folder / grf), motion.times, cutoff_hz=6.0)
    loads = assign_foot_loads(forces, assign_plates(forces, feet), {foot: foot for foot in feet})
    times = np.linspace(motion.times[0], motion.times[-1], len(motion.times))
    q = differentiate_motion(model, motion.times, motion.q, cutoff_hz=6.0).q
    rated = RatedMotion(times, q, *differentiate_spline(times, q))
    loads = replace(loads, times=times)
    return folder / file, model, compute_dynamics(model, rated, loads, trial=name), loads


def opensims(
    path: Path, model: BodyModel, ours: InverseDynamics, loads: SegmentLoads, folder: Path
) -> OpenSimId:
    """OpenSim's tool on the same motion and loads."""
    columns = [ours.motion.q]
    names, kinds = list(model.coordinate_names), [c.kind for c in model.coordinates]
    for coupler in model.couplers:  # of a coupled kind: OpenSim takes it in radians always
        names.append(coupler.dependent)
        kinds.append("translation")
        columns.append(ours.motion.q[:, [model.coordinate_names.index(coupler.independent)]])
    write_sto(
        folder / "q.mot",
        tabulate_motion("q", ours.motion.times, names, kinds, np.concatenate(columns, axis=1)),
    )
    data, labels = [ours.motion.times[:, None]], ["time"]
    for k, segment in enumerate(loads.segments):
        data += [loads.force[:, k], np.zeros((len(ours.motion.times), 3)), loads.moment[:, k]]
        labels += [f"{segment}_{what}{axis}" for what in "vpm" for axis in "xyz"]
    write_sto(folder / "f.mot", Table(name="f", columns=tuple(labels), data=np.concatenate(data, axis=1)))
    write_loads(folder / "loads.xml", folder / "f.mot", {s: s for s in loads.segments})
    return run_opensim_id(path, folder / "q.mot", folder / "loads.xml")


def differences(model: BodyModel, ours: InverseDynamics, theirs: OpenSimId) -> dict[str, float]:
    """Largest difference per coordinate over body weight; a dependent one's force counts with its own."""
    found = {}
    for k, name in enumerate(model.coordinate_names):
        follows = [name, *(c.dependent for c in model.couplers if c.independent == name)]
        force = sum(
            theirs.forces[key]
            for f in follows
            for key in (f"{f}_moment", f"{f}_force")
            if key in theirs.forces
        )
        found[name] = float(np.abs(force - ours.forces[:, k]).max() / (ours.mass * 9.80665))
    return found


def test_the_plates_tell_the_weight_that_a_laboratory_declared(shared_data: Path) -> None:
    _, _, dynamics, _ = recorded(shared_data, "gait2354")
    weight = weigh_motions({"walk": (dynamics, dynamics.known)})
    assert weight is not None
    assert weight.declared_kg == pytest.approx(75.16, abs=0.01)  # the generic model's
    assert weight.plates_kg == pytest.approx(72.6, abs=1.0)
    assert abs(weight.plates_kg - 72.6) < 1.96 * weight.sd_kg


@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
def test_joint_forces_equal_opensims_where_joints_are_simple(shared_data: Path, tmp_path: Path) -> None:
    path, model, ours, loads = recorded(shared_data, "gait2354")
    theirs = opensims(path, model, ours, loads, tmp_path)
    assert max(differences(model, ours, theirs).values()) < 1e-6


@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
def test_where_opensim_differs_it_is_opensim_that_misses_the_balance_of_momentum(
    shared_data: Path, tmp_path: Path
) -> None:
    path, model, ours, loads = recorded(shared_data, "opencap_squat")
    theirs = opensims(path, model, ours, loads, tmp_path)
    weight = ours.mass * 9.80665
    needed = force_of_momentum(model, ours) - ours.external[:, :3]
    root = np.stack([theirs.forces[f"pelvis_t{axis}_force"] for axis in "xyz"], axis=1)
    inner = slice(5, -5)
    assert np.abs(ours.residual[:, :3] - needed)[inner].max() < 1e-6 * weight
    assert np.abs(root - needed)[inner].max() > 1e-5 * weight
    # Their knees turn and glide by several functions; joints below them are simple again.
    assert max(differences(model, ours, theirs).values()) < 1e-3


def force_of_momentum(model: BodyModel, ours: InverseDynamics) -> Array:
    """m (a - g) from second differences of the centre of mass along the motion's splines, (n, 3)."""
    motion, mechanism, step = ours.motion, compile_mechanism(model), 1e-3
    ends = [(3, np.zeros(motion.q.shape[1])), (4, np.zeros(motion.q.shape[1]))]
    spline = make_interp_spline(motion.times, motion.q, k=5, bc_type=(ends, ends))
    masses = mechanism.inertias.mass

    def centre(times: Array) -> Array:
        placed = place_tree_markers(
            mechanism.tree, pose_links(mechanism.tree, np.ascontiguousarray(spline(times).T), np.zeros(0))
        )
        return np.einsum("k,kan->na", masses / masses.sum(), placed)

    at = [centre(motion.times + k * step) for k in (-3, -2, -1, 0, 1, 2, 3)]
    weights = np.array([2, -27, 270, -490, 270, -27, 2]) / 180.0  # central, sixth order
    acceleration = np.einsum("k,kna->na", weights, at) / step**2
    return np.asarray(sum_mass(model) * (acceleration - GRAVITY))
