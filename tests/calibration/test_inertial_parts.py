"""The parts of inertial identification against closed forms and other ways to the same numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from scaling_service.capabilities.dynamics.inertia.evidence import (
    ForceRecording,
    count_repeats,
    estimate_noise,
    gather_evidence,
)
from scaling_service.capabilities.dynamics.inertia.identification import (
    KEPT,
    Body,
    form_pseudo_inertia,
    list_bodies,
    minimise_within_cone,
)
from scaling_service.capabilities.dynamics.inertia.parameters import (
    COM_SD,
    LENGTH_SD,
    MASS_SD,
    PriorSpread,
    make_inertial_prior,
)
from scaling_service.core.errors import TrialUnusable
from scaling_service.model.anatomy.inertia import apply_inertia_table
from scaling_service.model.inertia import TABLE_NAMES, gather_inertias, with_inertias
from scaling_service.numerics.multibody.motion import Inertias
from tests.calibration.forced import BODY, other_person, recorded, wrench_error


def cloud(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Point masses (20,) and places (20, 3)."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0.1, 0.5, 20), rng.normal((0.1, -0.2, 0.05), 0.1, (20, 3))


def parameters_of(mass: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The ten parameters of point masses, by their definition."""
    squares = (at**2).sum(axis=1)
    tensor = np.einsum("k,kij->ij", mass, squares[:, None, None] * np.eye(3) - at[:, :, None] * at[:, None])
    six = [tensor[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return np.array([mass.sum(), *(mass @ at), *six])


def test_the_pseudo_inertia_is_the_moment_matrix_of_the_mass() -> None:
    mass, at = cloud(0)
    bordered = np.column_stack([at, np.ones(len(at))])
    expected = np.einsum("k,ki,kj->ij", mass, bordered, bordered)
    np.testing.assert_allclose(form_pseudo_inertia(parameters_of(mass, at)), expected, atol=1e-12)


@pytest.mark.parametrize("pull", [0.05, 3.0])
def test_the_minimum_is_that_of_another_solver(pull: float) -> None:
    mean = parameters_of(*cloud(1))
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(10, 4)) * np.abs(mean[:, None]) * 0.3
    curvature, slope = rng.uniform(1, 5, 4), pull * rng.normal(size=4)
    com = mean[1:4] / mean[0]
    body = Body(0, com - 0.03, com + 0.03)
    found = minimise_within_cone(curvature, slope, mean[None], directions, (body,))
    assert found is not None
    prior = form_pseudo_inertia(mean)

    def cost(y: np.ndarray) -> float:
        return float(0.5 * y @ (curvature * y) - slope @ y)

    def slack(y: np.ndarray) -> np.ndarray:
        there = mean + directions @ y
        left = np.linalg.eigvalsh(form_pseudo_inertia(there) - KEPT * prior)
        return np.concatenate([left, there[1:4] - body.low * there[0], body.high * there[0] - there[1:4]])

    other = minimize(
        cost, np.zeros(4), constraints={"type": "ineq", "fun": slack}, method="SLSQP", options={"ftol": 1e-12}
    )
    assert slack(found).min() > -1e-8
    assert cost(found) <= other.fun + 1e-6
    free = slope / curvature
    assert (slack(free).min() > 0) == (pull < 1)  # the second case runs into the limits
    if pull < 1:
        np.testing.assert_allclose(found, free, atol=1e-6)


def test_the_priors_spread_is_that_between_the_tables() -> None:
    mass, com, length = [], [], []
    middle = [k for k, name in enumerate(BODY.segment_names) if not name.endswith("_l")]
    for sex, height, weight in (("M", 1.77, 75.0), ("F", 1.61, 58.0)):
        found = [
            gather_inertias(apply_inertia_table(BODY, t, sex=sex, height_m=height, mass_kg=weight).model)
            for t in TABLE_NAMES
        ]
        masses, centres = np.array([i.mass for i in found]), np.array([i.com for i in found])
        tensors = np.array([i.tensor for i in found])
        second = 0.5 * np.trace(tensors, axis1=2, axis2=3)[..., None] - np.diagonal(tensors, axis1=2, axis2=3)
        sizes = np.sqrt(np.clip(second, 0.0, None) / masses[..., None])
        mass.append((masses.std(axis=0, ddof=1) / masses.mean(axis=0))[middle])
        com.append((centres.std(axis=0, ddof=1) / sizes.mean(axis=0))[middle])
        length.append((sizes.std(axis=0, ddof=1) / sizes.mean(axis=0))[middle])
    for values, stated in ((mass, MASS_SD), (com, COM_SD), (length, LENGTH_SD)):
        np.testing.assert_allclose(np.median(np.concatenate(values)), stated, rtol=0.08)


def test_the_priors_slopes_are_derivatives() -> None:
    prior = make_inertial_prior(BODY, PriorSpread(), mass_known=False, symmetric=False)
    inertias, step, k = gather_inertias(BODY), 1e-6, 7
    com = inertias.com.copy()
    com[k, 0] += step * prior.sd[k, 1]
    mass = inertias.mass.copy()
    mass[k] += step * prior.sd[k, 0]
    second = np.zeros((3, 3))
    second[0, 1] = second[1, 0] = step * prior.sd[k, 7]
    tensor = inertias.tensor.copy()
    tensor[k] += np.trace(second) * np.eye(3) - second
    for row, moved in (
        (1, replace(inertias, com=com)),
        (0, replace(inertias, mass=mass)),
        (7, replace(inertias, tensor=tensor)),
    ):
        slope = (moved.parameters() - prior.mean).ravel() / step
        np.testing.assert_allclose(prior.scale[:, 10 * k + row], slope, atol=1e-6)


def test_known_mass_and_symmetry_bind_the_prior() -> None:
    prior = make_inertial_prior(BODY, PriorSpread(), mass_known=True, symmetric=True)
    np.testing.assert_allclose(prior.basis.T @ prior.basis, np.eye(prior.basis.shape[1]), atol=1e-12)
    masses = prior.scale[::10] @ prior.basis
    np.testing.assert_allclose(masses.sum(axis=0), 0.0, atol=1e-12)
    names = list(prior.segments)
    right, left = (10 * names.index(f"femur_{side}") for side in "rl")
    mirror = np.array([1, 1, 1, -1, 1, 1, 1, 1, -1, -1])
    np.testing.assert_allclose(
        prior.basis[left : left + 10], mirror[:, None] * prior.basis[right : right + 10]
    )


def test_normal_equations_tell_the_error_that_inverse_dynamics_has() -> None:
    person, _ = other_person(4)
    recording = recorded(person, 1, 2.0)
    change = (gather_inertias(person).parameters() - gather_inertias(BODY).parameters()).ravel()
    evidence = gather_evidence(BODY, recording)
    np.testing.assert_allclose(evidence.rms(np.zeros_like(change)), wrench_error(BODY, recording), rtol=1e-9)
    np.testing.assert_allclose(evidence.rms(change), wrench_error(person, recording), rtol=1e-6)


def test_one_nan_frame_is_left_out_and_none_left_is_reported() -> None:
    whole = recorded(BODY, 1, 1.0)
    external = whole.dynamics.external.copy()
    residual = whole.dynamics.residual.copy()
    external[30], residual[30] = np.nan, np.nan
    spoilt = ForceRecording(replace(whole.dynamics, external=external, residual=residual))
    without = np.arange(len(external)) != 30
    left, expected = gather_evidence(BODY, spoilt), gather_evidence(BODY, replace(whole, frames=without))
    assert left.frames == len(external) - 1
    np.testing.assert_allclose(left.slope, expected.slope, rtol=1e-12)
    with pytest.raises(TrialUnusable, match="no frame has both"):
        gather_evidence(BODY, replace(whole, frames=np.zeros(len(external), dtype=bool)))


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_repetition_of_an_autoregressive_error(rho: float) -> None:
    rng, values = np.random.default_rng(0), np.zeros(40000)
    for k in range(1, len(values)):
        values[k] = rho * values[k - 1] + rng.normal()
    values[::50] = np.nan
    assert count_repeats(values) == pytest.approx((1 + rho) / (1 - rho), rel=0.12)
    assert count_repeats(values + 7.0) == pytest.approx(count_repeats(values))
    assert count_repeats(np.full(10, 3.0)) == 1.0
    assert count_repeats(np.full(10, np.nan)) == 1.0


def test_boxes_hold_joints_markers_and_the_centre_of_mass() -> None:
    bodies = {BODY.segment_names[b.row]: b for b in list_bodies(BODY)}
    thigh = bodies["femur_r"]
    assert thigh.low[1] < -0.38  # down to the knee
    assert thigh.high[1] >= 0.0
    for name, body in bodies.items():
        com = np.array(BODY.segment(name).com)
        assert (body.low < com).all()
        assert (com < body.high).all()
    markers = np.array([m.nominal for m in BODY.markers if m.segment == "femur_r"])
    assert (thigh.low <= markers.min(axis=0)).all()
    assert (markers.max(axis=0) <= thigh.high).all()
    light = with_inertias(BODY, Inertias.of_parameters(np.zeros((len(BODY.segments), 10))))
    assert list_bodies(light) == ()


@pytest.mark.parametrize(("count", "noise"), [(400, 0.5), (400, 5.0), (60, 2.0)])
def test_the_noise_is_found_although_a_fit_takes_up_freedom(count: int, noise: float) -> None:
    """Forty parameters of unit spread; with sixty errors a plain fit would leave a third of the noise."""
    found = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        design = rng.normal(size=(count, 40))
        errors = design @ rng.normal(size=40) + noise * rng.normal(size=count)
        gains, vectors = np.linalg.eigh(design.T @ design)
        slopes = vectors.T @ (design.T @ errors)
        found.append(estimate_noise(gains, slopes, float(errors @ errors), count))
    assert np.median(found) == pytest.approx(noise, rel=0.1)
