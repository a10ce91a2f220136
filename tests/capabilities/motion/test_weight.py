"""The momentum balance: weight from vertical forces, whatever the person does."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.dynamics.weight import PLATES_SHARE, Weight, weigh
from scaling_service.core.errors import TrialUnusable

RNG = np.random.default_rng(5)
G = 9.80665


def recording(kg: float, model_kg: float, seconds: int = 10) -> list[tuple[np.ndarray, np.ndarray]]:
    """Blocks of half a second of somebody who jumps: measured force, and what the model needs."""
    pull = np.where(np.arange(100 * seconds) // 30 % 4 == 3, -G, 3.0 * RNG.standard_normal(100 * seconds))
    noise = 2.0 * RNG.standard_normal(len(pull))
    rows = np.array_split(np.arange(len(pull)), 2 * seconds)
    return [(kg * (G + pull[r]) + noise[r], model_kg * (G + pull[r])) for r in rows]


def weight_of(**recordings: list[tuple[np.ndarray, np.ndarray]]) -> Weight:
    found = weigh(62.6, recordings)
    assert found is not None
    return found


def test_flight_and_jumps_do_not_change_the_weight() -> None:
    found = weight_of(jumps=recording(60.1, 62.6))
    assert found.plates_kg == pytest.approx(60.1, abs=0.15)
    assert found.differs
    assert "60.1 kg" in found.sentences[0]


def test_a_right_mass_is_not_reported() -> None:
    assert weight_of(jumps=recording(62.6, 62.6)).sentences == ()


def test_a_chair_that_bears_part_of_the_time_does_not_lighten_the_person() -> None:
    some = recording(62.6, 62.6)
    seated = [(0.4 * m, n) for m, n in some[:6]] + some[6:]
    assert not weight_of(rising=seated).differs


def test_recordings_that_disagree_are_reported_and_widen_the_deviation() -> None:
    squat, walk = recording(60.1, 62.6, 13), recording(63.6, 62.6, 2)
    both = weight_of(squat=squat, walk=walk)
    assert both.plates_kg == pytest.approx(60.1, abs=0.3)
    assert both.sd_kg > weight_of(squat=squat).sd_kg
    assert "disagree" in both.sentences[1]


def test_the_interval_covers_the_true_mass() -> None:
    """Over plates whose gains stray as makers state."""
    true = RNG.uniform(50.0, 75.0, 2000)
    read = true * (1.0 + PLATES_SHARE * RNG.standard_normal(2000))
    found = [weight_of(a=recording(kg, 62.6, 4)) for kg in read]
    covered = [abs(f.plates_kg - kg) <= 1.96 * f.sd_kg for f, kg in zip(found, true, strict=True)]
    assert 0.92 < np.mean(covered) < 0.98


def test_a_mass_that_the_plates_cannot_mean_is_refused() -> None:
    with pytest.raises(TrialUnusable, match=r"the model weighs 10\.0 kg"):
        Weight(declared_kg=10.0, plates_kg=60.0, sd_kg=0.2, by_trial={"a": 60.0}).check()


def test_nothing_that_counts_gives_no_weight() -> None:
    assert weigh(62.6, {"a": []}) is None
