"""Skin that oscillates is found with its frequency and damping, though the pose follows it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.signal import lsim

from scaling_service.capabilities.discovery.effects import catalogue
from scaling_service.capabilities.discovery.effects.catalogue import find_effects
from scaling_service.capabilities.discovery.effects.masses import is_within_reach, make_nearest_bone_test
from scaling_service.capabilities.discovery.evidence.fit import Recording, SearchContext, fit_recordings
from scaling_service.capabilities.discovery.laws.candidates import Estimate
from scaling_service.capabilities.discovery.search.discover import discover
from scaling_service.capabilities.discovery.search.estimation import estimate
from scaling_service.numerics.multibody.laws import Array
from tests.discovery.hidden import candidate, person, recorded

FREQUENCY_HZ, DAMPING = 5.0, 0.2


def lagging(times: Array, path: Array) -> Array:
    """How far a spring and damper lag behind a path (n, 3) that shakes them, by scipy's own integration."""
    shaking = make_interp_spline(times, path, k=5).derivative(2)(times)
    w = 2.0 * np.pi * FREQUENCY_HZ
    system = ([-1.0], [1.0, 2.0 * DAMPING * w, w * w])
    return np.stack([lsim(system, shaking[:, k], times)[1] for k in range(3)], axis=1)


def shaken(marker: str, seed: int = 0) -> list[Recording]:
    """Recordings in which the skin under one marker oscillates."""
    made = []
    for item in recorded(person(), person().model, seed=seed):
        name, k = item.trial.name, item.trial.index(marker)
        still = person().trials[name].markers[:, person().trials[name].index(marker)]
        markers = item.trial.markers.copy()
        markers[:, k] += lagging(item.trial.times, still)
        made.append(Recording(item.trial.with_markers(markers), item.role))
    return made


def test_an_oscillation_is_named_with_its_frequency_and_damping() -> None:
    result = discover(person().model, shaken("RLM"))
    (named,) = result.findings.named
    assert named.effect.candidate.kind == "skin_wobble"
    assert named.effect.candidate.where == ("RLM",)
    assert named.details["frequency_hz"] == pytest.approx(FREQUENCY_HZ, rel=0.05)
    assert named.details["damping"] == pytest.approx(DAMPING, rel=0.25)
    assert float(named.effect.size[0]) == pytest.approx(1.0, abs=0.1)
    assert 0.0 < named.spreads["frequency_hz"] < 0.3
    whitened = result.findings.held_out.levels["whitened"]
    assert whitened.before - whitened.after > 0.9 * (whitened.before - 1.0)


def test_noise_makes_what_oscillates_neither_smaller_nor_slower() -> None:
    """Noise of the cameras shakes the bone, too: taken for the drive it would take off 6 % and 2 %."""
    found = []
    for seed in range(4):
        start = fit_recordings(SearchContext(model=person().model, recordings=shaken("RLM", seed)))
        hidden = Estimate(candidate("skin_wobble", "RLM").at(FREQUENCY_HZ, DAMPING), np.ones(1))
        (effect,) = estimate(start, [hidden]).effects
        found.append([float(effect.size[0]), *(effect.candidate.oscillation or ())])
    share, frequency, damping = np.mean(found, axis=0)
    assert share == pytest.approx(1.0, abs=0.03)
    assert frequency == pytest.approx(FREQUENCY_HZ, rel=0.006)
    assert damping == pytest.approx(DAMPING, rel=0.06)


def test_a_load_hangs_within_reach_and_at_its_own_bone() -> None:
    assert is_within_reach(np.array([2.0, 0.6, 0.0, 0.0]))
    assert not is_within_reach(np.array([2.0, 0.0, -7.0, 0.0]))
    near = make_nearest_bone_test(person().model)
    thigh, shank = near("femur_r"), near("tibia_r")
    assert shank(np.array([2.0, 0.1, -0.4, 0.0]))  # 0.2 m down the shank
    assert not thigh(np.array([2.0, 0.1, -1.2, 0.0]))  # the same place
    assert thigh(np.array([2.0, 0.1, -0.4, 0.0]))  # half way down the thigh
    assert not shank(np.array([2.0, 0.0, 0.4, 0.0]))  # half way up it


def test_each_number_keeps_to_its_range() -> None:
    scale = candidate("capture_scale", "markers")
    assert scale.plausible(np.array([0.01]))
    assert not scale.plausible(np.array([3.0]))


def test_an_effect_of_another_distribution_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """By an entry point of an object with the attributes of an effect; of a module all the same."""
    lift = SimpleNamespace(
        kind="shoe_lift", meaning="the shoes raise the feet", candidates=lambda _: iter(())
    )
    points = {"scaling_service.effects": [SimpleNamespace(load=lambda: lift)]}
    monkeypatch.setattr(catalogue, "entry_points", lambda group: points[group])
    catalogue.find_effects.cache_clear()
    try:
        assert catalogue.find_effects()["shoe_lift"].meaning == lift.meaning
        assert len(catalogue.find_effects()) == 23
    finally:
        catalogue.find_effects.cache_clear()


def test_every_effect_is_a_sum_of_columns_searches_for_itself_or_asks_a_question() -> None:
    assert len(find_effects()) == 22
    for kind, effect in find_effects().items():
        ways = (effect.candidates, effect.search, effect.question)
        assert sum(way is not None for way in ways) == 1, kind
        assert len(effect.meaning) > 10
