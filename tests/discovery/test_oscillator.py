"""Something on a spring against closed forms."""

from __future__ import annotations

import numpy as np

from scaling_service.capabilities.discovery.observations.oscillator import (
    compute_pull,
    simulate_oscillator,
)

STEP, FREQUENCY, DAMPING = 0.01, 3.0, 0.2
W = 2.0 * np.pi * FREQUENCY


def test_a_steady_pull_holds_it_still_from_the_first_frame_on() -> None:
    place, speed = simulate_oscillator(np.full((200, 3), 2.5), STEP, FREQUENCY, DAMPING)
    np.testing.assert_allclose(place, 2.5 / W**2, rtol=1e-9)
    np.testing.assert_allclose(speed, 0.0, atol=1e-12)


def test_a_wave_makes_it_swing_as_the_closed_form_says() -> None:
    """u = Re(e^{i v t} / (w^2 - v^2 + 2 i z w v)) once what it began with has died away."""
    times, v = STEP * np.arange(1000), 2.0 * np.pi * 2.2
    place, speed = simulate_oscillator(np.cos(v * times), STEP, FREQUENCY, DAMPING)
    steady = np.exp(1j * v * times) / (W**2 - v**2 + 2j * DAMPING * W * v)
    late = times > 4.0
    np.testing.assert_allclose(place[late], steady.real[late], atol=2e-3 * np.abs(steady[0]))
    np.testing.assert_allclose(speed[late], (1j * v * steady).real[late], atol=2e-3 * v * np.abs(steady[0]))


def test_points_on_a_wave_are_pulled_as_the_closed_form_says() -> None:
    v = 2.0 * np.pi * 2.2
    times = STEP * np.arange(400)
    pull = compute_pull(np.cos(v * times)[:, None], STEP)[:, 0]
    inside = slice(50, -50)
    np.testing.assert_allclose(pull[inside], (v**2 * np.cos(v * times))[inside], atol=2e-3 * v**2)
