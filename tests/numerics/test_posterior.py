"""The Gaussian posterior: closed forms, and what a linear problem must give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Marker, Segment, to_vector
from scaling_service.model.compile import compile_model
from scaling_service.model.freed import free_named
from scaling_service.model.parameters import free_marker
from scaling_service.model.people import SkinSize
from scaling_service.numerics.least_squares.posterior import integrate_over, solve_posterior
from scaling_service.numerics.least_squares.problem import Outcome
from scaling_service.numerics.least_squares.whitening import ErrorGroup, GaussianPrior, PosteriorProblem
from scaling_service.numerics.multibody.rigid import rotate_about
from scaling_service.numerics.multibody.tree import pose_markers


def test_prior_of_sums_is_that_of_the_closed_form():
    rng = np.random.default_rng(1)
    rows, covariance = rng.normal(size=(2, 3)), np.array([[2.0, 0.3], [0.3, 1.0]])
    mean, own = np.array([0.5, -1.0]), np.diag([1.0, 2.0, 3.0])
    prior = GaussianPrior(["a", "b", "c"])
    prior.add_values(["c", "a", "b"], np.zeros(3), own[np.ix_([2, 0, 1], [2, 0, 1])])
    prior.add([dict(zip("abc", row, strict=True)) for row in rows], mean, covariance)
    gain = own @ rows.T @ np.linalg.inv(rows @ own @ rows.T + covariance)
    np.testing.assert_allclose(np.linalg.solve(prior.precision, prior.pull), gain @ mean, atol=1e-12)
    np.testing.assert_allclose(np.linalg.inv(prior.precision), own - gain @ rows @ own, atol=1e-12)


def slider() -> BodyModel:
    """A block that slides along x and carries three markers."""
    joint = Joint("translation", (1.0, 0.0, 0.0), Law.of("x"))
    block = Segment(name="block", parent="ground", joint_name="rail", joints=(joint,), mass=1.0)
    places = {"A": (0.1, 0.0, 0.0), "B": (0.0, 0.2, 0.0), "C": (0.0, 0.0, 0.3)}
    markers = tuple(Marker.at(name, "block", at) for name, at in places.items())
    coordinate = Coordinate(name="x", lower=-9.0, upper=9.0, kind="translation")
    return BodyModel(name="slider", segments=(block,), coordinates=(coordinate,), markers=markers)


@pytest.mark.parametrize("hidden", [False, True])
def test_linear_problem_is_generalised_least_squares(hidden):
    """Three frames of a sliding block, markers that err together, one shared shift: all linear."""
    rng = np.random.default_rng(2)
    model = free_marker(slider(), "B", "xy", 1.0)
    tree = compile_model(model)
    local = np.array([m.nominal for m in slider().markers])
    covariance = SkinSize(shift=0.003, turn=0.02, single=0.002).covariance(local)
    noise = rng.multivariate_normal(np.zeros(9), covariance, 3).reshape(3, 3, 3)
    measured = local + np.array([1.0, 2.0, 3.0])[:, None, None] * [1.0, 0.0, 0.0] + noise
    if hidden:
        measured[1, 2] = np.nan
    shares = np.array([1.0, 0.5, 1.0])
    prior = GaussianPrior([p.name for p in model.parameters])
    prior.add_values(prior.names, np.array([0.001, 0.0]), np.diag([0.004**2, 0.01**2]))
    problem = PosteriorProblem(
        tree=tree,
        measured=measured,
        shares=shares,
        coordinates=np.array([0]),
        groups=(ErrorGroup(np.arange(3), covariance),),
        prior=prior,
    )
    found = solve_posterior(problem, np.zeros((3, 1)), np.zeros(2))

    design, precision, gap = np.zeros((27, 5)), np.zeros((27, 27)), (measured - local).ravel()
    for frame in range(3):
        rows = slice(9 * frame, 9 * frame + 9)
        design[rows, frame] = np.tile([1.0, 0.0, 0.0], 3)
        design[9 * frame + 3, 3] = design[9 * frame + 4, 4] = 1.0
        seen = np.flatnonzero(np.isfinite(gap[rows]))
        at = np.ix_(9 * frame + seen, 9 * frame + seen)
        precision[at] = shares[frame] * np.linalg.inv(covariance[np.ix_(seen, seen)])
    whole = design.T @ precision @ design
    whole[3:, 3:] += prior.precision
    right = design.T @ precision @ np.nan_to_num(gap) + np.concatenate([np.zeros(3), prior.pull])
    expected = np.linalg.solve(whole, right)
    assert found.outcome is Outcome.CONVERGED
    np.testing.assert_allclose(np.concatenate([found.q[:, 0], found.p]), expected, atol=1e-8)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(whole)[3:, 3:], rtol=1e-5, atol=1e-12)


def test_covariance_of_skin_is_that_of_drawn_displacements():
    rng = np.random.default_rng(3)
    places, size = rng.normal(0.0, 0.1, (4, 3)), SkinSize(shift=0.006, turn=0.07, single=0.004)
    n = 40_000
    shift, turn = rng.normal(0, size.shift, (n, 1, 3)), rng.normal(0, size.turn, (n, 1, 3))
    drawn = shift + np.cross(turn, places - places.mean(axis=0)) + rng.normal(0, size.single, (n, 4, 3))
    sample = np.cov(drawn.reshape(n, -1).T)
    np.testing.assert_allclose(sample, size.covariance(places), atol=4 * sample.max() / np.sqrt(n))


def test_skin_does_not_depend_on_the_axes_of_the_link():
    places, size = (
        np.random.default_rng(4).normal(0.0, 0.1, (3, 3)),
        SkinSize(shift=0.003, turn=0.05, single=0.002),
    )
    R = rotate_about((0.6, 0.0, 0.8), 1.1)
    turned = np.kron(np.eye(3), R) @ size.covariance(places) @ np.kron(np.eye(3), R).T
    np.testing.assert_allclose(size.covariance(places @ R.T), turned, atol=1e-15)


def swinging() -> BodyModel:
    """A block that slides and turns, with markers that slide with its turn by unknown slopes."""
    axes = dict(zip("xyz", np.eye(3).tolist(), strict=True))
    rails = tuple(Joint("translation", to_vector(axis), Law.of(name)) for name, axis in axes.items())
    hinge = Joint("rotation", (0.0, 0.0, 1.0), Law.of("turn"))
    block = Segment(name="block", parent="ground", joint_name="rail", joints=(*rails, hinge), mass=1.0)
    places = {"A": (0.1, 0.0, 0.0), "B": (0.0, 0.2, 0.0), "C": (0.05, 0.1, 0.3)}
    markers = tuple(Marker.at(name, "block", at) for name, at in places.items())
    coordinates = (
        *(Coordinate(name=name, lower=-9.0, upper=9.0, kind="translation") for name in axes),
        Coordinate(name="turn", lower=-3.0, upper=3.0),
    )
    model = BodyModel(name="block", segments=(block,), coordinates=coordinates, markers=markers)
    names = [f"{kind}.{marker}.{axis}" for kind in ("marker", "skin") for marker in "ABC" for axis in "xyz"]
    return free_named(model, [f"{name}.turn" if name.startswith("skin") else name for name in names])


def test_integral_over_places_and_slopes_has_the_slope_of_the_determinant():
    """Half of log det of the curvature: its derivative with each frame's turn, by differences."""
    model, rng = swinging(), np.random.default_rng(3)
    tree = compile_model(model)
    q = np.column_stack([rng.normal(size=(6, 3)), rng.normal(0.2, 0.4, size=6)])
    prior = GaussianPrior([p.name for p in model.parameters])
    prior.add_values(prior.names, np.zeros(18), np.diag(np.repeat([0.01, 0.02], 9) ** 2))
    covariance = SkinSize(shift=0.003, turn=0.02, single=0.002).covariance(
        np.array([m.nominal for m in model.markers])
    )
    problem = PosteriorProblem(
        tree=tree,
        measured=pose_markers(tree, q, np.zeros(18)),
        shares=np.array([1.0, 0.5, 1.0, 0.2, 1.0, 1.0]),
        coordinates=np.arange(4),
        groups=(ErrorGroup(np.arange(3), covariance),),
        prior=prior,
    )

    def log_determinant(at: np.ndarray) -> float:
        still = replace(problem, measured=pose_markers(tree, at, np.zeros(18)))
        return -np.linalg.slogdet(solve_posterior(still, at, np.zeros(18), most=0).covariance)[1]

    precision, pull = integrate_over(problem, q, np.zeros(18), np.arange(18)).integrated
    ours = 2.0 * (np.einsum("nij,nj->ni", precision, q) - pull)
    step = 1e-5
    for frame in range(6):
        moved = [q.copy(), q.copy()]
        moved[0][frame, 3] -= step
        moved[1][frame, 3] += step
        slope = (log_determinant(moved[1]) - log_determinant(moved[0])) / (2.0 * step)
        assert ours[frame, 3] == pytest.approx(slope, rel=1e-4)
    np.testing.assert_allclose(ours[:, :3], 0.0, atol=1e-12)
