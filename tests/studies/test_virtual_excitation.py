"""Virtual persons on force plates: every joint moves, bearing feet stand still, true forces leave nothing."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.kinetics.inverse_dynamics import compute_dynamics, differentiate_motion
from scaling_service.capabilities.motion.kinematic_error import kinematic_error
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.inertia import gather_inertias, sum_mass
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.studies.muller2017.excitation import (
    ExcitationSettings,
    make_excited_person,
    simulate_sequence,
)

SHORT = ExcitationSettings(seconds=4.0)
EXACT = ExcitationSettings(seconds=4.0, skin=0.0, noise=0.0, inertia=0.0, calibration=0.0)


def test_a_minute_moves_every_joint_and_bearing_feet_stand_still() -> None:
    body = load_builtin("full_body_35dof")
    times = np.arange(6000) / 100
    q, right = simulate_sequence(body, times, np.random.default_rng(0), 1.76)
    reach = np.degrees(np.ptp(q, axis=0))
    for coordinate, span in zip(body.coordinates, reach, strict=True):
        if not coordinate.name.startswith("pelvis"):
            assert span > 9.0, coordinate.name
    assert right.min() < 1e-6
    assert right.max() > 1 - 1e-6
    heels = pose_markers(compile_model(body, ("RHEE", "LHEE")), q, list_parameter_values(body))
    speed = np.linalg.norm(np.gradient(heels, 0.01, axis=0), axis=2)
    # a bearing foot turns with sway only: some cm/s at the heel; a free one is lifted faster
    assert np.percentile(speed[right > 0.99, 0], 95) < 0.1
    assert speed[right < 0.01, 0].max() > 0.5


def test_true_forces_leave_nothing_of_the_true_motion() -> None:
    person = make_excited_person(3, SHORT, ("in_order",))
    performance = person.performances["in_order"]
    rated = differentiate_motion(person.truth, performance.times, performance.q, cutoff_hz=None)
    residual = compute_dynamics(person.truth, rated, performance.loads).residual
    np.testing.assert_allclose(residual, 0.0, atol=1e-8)
    vertical = performance.loads.force[..., 1]
    assert (vertical > -1e-9).all()
    assert vertical.sum(axis=1).mean() == pytest.approx(person.mass_kg * 9.80665, rel=0.05)


@pytest.mark.costly
def test_persons_without_faults_are_followed_exactly_and_with_faults_as_usual() -> None:
    exact = make_excited_person(3, EXACT, ("in_order",))
    motion = exact.performances["in_order"].recording.motion
    assert kinematic_error(motion, exact.model).mean < 1e-5
    np.testing.assert_allclose(
        gather_inertias(exact.truth).mass, gather_inertias(exact.model).mass, rtol=1e-9
    )
    usual = make_excited_person(3, SHORT, ("in_order",))
    error = kinematic_error(usual.performances["in_order"].recording.motion, usual.model).mean
    assert 0.004 < error < 0.02
    assert np.abs(gather_inertias(usual.truth).mass / gather_inertias(usual.model).mass - 1).max() > 0.05
    assert abs(sum_mass(usual.truth) - sum_mass(usual.model)) < 1e-6 * usual.mass_kg


def test_a_person_is_the_same_whatever_is_recorded() -> None:
    one = make_excited_person(4, SHORT, ("in_order",))
    both = make_excited_person(4, SHORT, ("in_order", "shuffled"))
    np.testing.assert_array_equal(
        one.performances["in_order"].recording.motion.q, both.performances["in_order"].recording.motion.q
    )
    shuffled = both.performances["shuffled"]
    assert np.abs(shuffled.q - both.performances["in_order"].q).max() > 0.1
