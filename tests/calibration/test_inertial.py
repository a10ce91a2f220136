"""Inertial identification on bodies whose inertia is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.dynamics.inertia.evidence import ForceRecording
from scaling_service.capabilities.dynamics.inertia.identification import (
    IdentificationSettings,
    form_pseudo_inertia,
    identify_inertia,
    list_bodies,
)
from scaling_service.capabilities.dynamics.inertia.parameters import PriorSpread, make_inertial_prior
from scaling_service.capabilities.kinetics.inverse_dynamics import compute_dynamics
from scaling_service.core.errors import InputError, TrialUnusable
from scaling_service.core.names import say_name
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.inertia import gather_inertias, sum_mass, with_inertias
from tests.calibration.forced import BODY, other_person, recorded, wrench_error

FREE = IdentificationSettings(mass_known=False)


def test_forces_without_noise_are_explained_also_where_they_were_not_fitted() -> None:
    person, _ = other_person(0)
    fitted, held_out = recorded(person, 1), recorded(person, 2, trial="others")
    found = identify_inertia(BODY, [fitted], held_out=[held_out])
    assert [fit.held_out for fit in found.fits] == [False, True]
    for fit, recording in zip(found.fits, (fitted, held_out), strict=True):
        np.testing.assert_allclose(fit.before, wrench_error(BODY, recording), rtol=1e-9)
        np.testing.assert_allclose(fit.after, wrench_error(found.model, recording), rtol=1e-3, atol=1e-6)
    assert (found.fits[1].after < 2.0 * found.noise).all()  # what a plate cannot resolve
    assert sum_mass(found.model) == pytest.approx(sum_mass(BODY), abs=1e-9)
    assert found.warnings == ()


def test_what_moved_is_known_as_well_as_it_says() -> None:
    """Over persons and combinations, errors over their standard deviations scatter as a unit normal."""
    scores = []
    for seed in range(12):
        person, _ = other_person(seed, 1.0)
        found = identify_inertia(BODY, [recorded(person, seed, 3.0)], noise=np.full(6, 3.0))
        true = dict(zip(BODY.segment_names, gather_inertias(person).mass, strict=True))
        scores += [(p.after - true[p.segment]) / p.sd for p in found.parameters if p.quantity == "mass"]
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.25


def test_it_comes_nearer_to_the_truth_than_the_table_and_more_so_with_less_noise() -> None:
    prior = make_inertial_prior(BODY, PriorSpread(), mass_known=True, symmetric=True)
    person, _ = other_person(5, 1.0)
    true = gather_inertias(person).parameters().ravel()

    def distance(model: object) -> float:
        change = gather_inertias(model).parameters().ravel() - true  # type: ignore[arg-type]
        return float(np.linalg.norm(np.linalg.lstsq(prior.scale @ prior.basis, change, rcond=None)[0]))

    away = [distance(identify_inertia(BODY, [recorded(person, 3, noise)]).model) for noise in (0.1, 3.0)]
    assert away[0] < away[1] < distance(BODY)


def test_only_directions_that_the_recording_determines_move() -> None:
    """Still standing tells the whole body's centre of mass at most: a handful of numbers."""
    person, _ = other_person(6, 1.0)
    lively = recorded(person, 1, 3.0)
    still = replace(lively.dynamics.motion, qdot=np.zeros((600, 35)), qddot=np.zeros((600, 35)))
    still = replace(still, q=np.tile(still.q[:1], (600, 1)))
    weight = compute_dynamics(person, still).residual
    root = compute_dynamics(person, still).root
    moment = weight[:, 3:] + np.cross(root, weight[:, :3])
    loads = SegmentLoads(still.times, ("pelvis",), weight[:, None, :3], moment[:, None])
    found = identify_inertia(
        BODY, [ForceRecording(compute_dynamics(BODY, still, loads))], noise=np.full(6, 0.1)
    )
    assert 1 <= len(found.combinations) <= 2  # weight acts along one line: its place fore-aft and sideways
    after = compute_dynamics(found.model, still, loads).residual
    assert np.abs(after).max() < 0.1 * np.abs(compute_dynamics(BODY, still, loads).residual).max()
    assert not any(p.identifiable for p in found.parameters if p.quantity.startswith("I"))


def test_the_plates_tell_the_total_mass_where_it_is_not_known() -> None:
    inertias = gather_inertias(BODY)
    heavier = with_inertias(BODY, replace(inertias, mass=1.06 * inertias.mass, tensor=1.06 * inertias.tensor))
    found = identify_inertia(BODY, [recorded(heavier, 1, 1.0)], settings=FREE)
    assert sum_mass(found.model) == pytest.approx(sum_mass(heavier), rel=2e-3)


def test_left_and_right_change_alike_unless_asked_otherwise() -> None:
    person, _ = other_person(7, 1.0, symmetric=False)
    settings = IdentificationSettings(symmetric=False)
    alike = identify_inertia(BODY, [recorded(person, 1)])
    free = identify_inertia(BODY, [recorded(person, 1)], settings=settings)
    masses = {p.segment: p.after for p in alike.parameters if p.quantity == "mass"}
    assert masses["tibia_r"] == pytest.approx(masses["tibia_l"], rel=1e-9)
    assert free.fits[0].after.sum() < 0.2 * alike.fits[0].after.sum()


def test_forces_that_no_body_explains_leave_a_possible_body() -> None:
    """Twenty times the table's differences, believed to a newton: the limits hold."""
    absurd = recorded(BODY, 1)
    person, _ = other_person(8, 0.5)
    strange = recorded(person, 1)
    external = absurd.dynamics.external + 20.0 * (strange.dynamics.external - absurd.dynamics.external)
    dynamics = replace(absurd.dynamics, external=external)
    found = identify_inertia(BODY, [ForceRecording(dynamics)], noise=np.ones(6))
    inertias = gather_inertias(found.model)
    assert (np.linalg.eigvalsh(form_pseudo_inertia(inertias.parameters())) > 0).all()
    for body in list_bodies(BODY):
        assert (inertias.com[body.row] > body.low - 1e-6).all()
        assert (inertias.com[body.row] < body.high + 1e-6).all()
    assert any("moved by more than 3" in said for said in found.warnings)


def test_the_verdict_is_obeyed() -> None:
    recording = recorded(other_person(0)[0], 1, 5.0)
    with pytest.raises(TrialUnusable, match="within the uncertainty of the measurement"):
        identify_inertia(BODY, [recording], supported=np.zeros(6, dtype=bool))
    forced = IdentificationSettings(despite_verdict=True)
    reported = identify_inertia(BODY, [recording], supported=np.zeros(6, dtype=bool), settings=forced)
    assert "it was identified all the same" in reported.warnings[0]
    part = identify_inertia(BODY, [recording], supported=[False] * 5 + [True])
    assert part.components == (False,) * 5 + (True,)
    assert np.isfinite(part.noise).tolist() == [False] * 5 + [True]
    with pytest.raises(InputError, match="no recording"):
        identify_inertia(BODY, [])


def test_fitted_noise_makes_held_out_forces_worse_and_it_is_reported() -> None:
    """The person is the table's own; each recording has its own slow error, believed not to be one."""
    rng = np.random.default_rng(0)

    def drifting(seed: int) -> ForceRecording:
        exact = recorded(BODY, seed, trial=f"m{seed}").dynamics
        slow = np.sin(np.linspace(0, 7, 600)[:, None] * rng.uniform(0.5, 2, 6) + rng.uniform(0, 6, 6))
        return ForceRecording(replace(exact, external=exact.external + 15.0 * slow))

    found = identify_inertia(BODY, [drifting(1)], held_out=[drifting(2)], noise=np.full(6, 0.5))
    assert found.relative_error(held_out=False) < 1.0
    assert found.relative_error(held_out=True) > 1.01
    assert "held-out recordings grew" in found.warnings[-1]


def test_an_impossible_prior_is_made_possible_and_reported() -> None:
    inertias = gather_inertias(BODY)
    tensor = inertias.tensor.copy()
    tensor[2] = np.diag([1.0, 1.0, 3.0]) * inertias.tensor[2, 0, 0]
    found = identify_inertia(with_inertias(BODY, replace(inertias, tensor=tensor)), [recorded(BODY, 1, 1.0)])
    assert f"no body can have the inertia of {say_name(BODY.segment_names[2])}" in found.warnings[0]
