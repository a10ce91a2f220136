"""What a declared mass says of loads and masses, against integrals over a grid, and of plates' gains."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.stats import norm

from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.capabilities.discovery.ordinary.odds import Scored
from scaling_service.capabilities.discovery.ordinary.witnesses import DECLARED, hear_declared, hear_sum
from scaling_service.capabilities.discovery.search.forces import place_mass
from scaling_service.capabilities.discovery.search.markers import Ranked

SD, SCORE, INFORMATION = 4.0, 9.0, 1.5  # kg; of forces that say 6 kg
DECLARED_KG = 60.0
GRID = np.linspace(-40.0, 60.0, 200_001)


def said_by_forces() -> Scored:
    return Scored.of(np.array([SCORE]), np.array([[INFORMATION]]), np.array([SD]))


def integrate(of: np.ndarray) -> tuple[float, float]:
    """Logarithm of the Bayes factor, and the mean size, where ``of`` is the likelihood of the witness."""
    weight = norm.pdf(GRID, scale=SD) * np.exp(SCORE * GRID - 0.5 * INFORMATION * GRID**2) * of
    total = trapezoid(weight, GRID)
    return float(np.log(total)), float(trapezoid(GRID * weight, GRID) / total)


def weigh_reading(value: float) -> np.ndarray:
    """Against no load: the likelihood of a reading of it."""
    sd = DECLARED * DECLARED_KG
    return np.asarray(norm.pdf(value, GRID, sd) / norm.pdf(value, 0.0, sd))


@pytest.mark.parametrize("borne", [58.0, 60.0, 67.0])
def test_what_is_carried_is_not_the_persons_own(borne: float) -> None:
    heard = hear_declared(said_by_forces(), borne_kg=borne, declared_kg=DECLARED_KG)
    bayes, size = integrate(weigh_reading(borne - DECLARED_KG))
    assert heard.bayes == pytest.approx(bayes, abs=1e-6)
    assert heard.size[0] == pytest.approx(size, abs=1e-6)


@pytest.mark.parametrize("model", [48.0, 54.0, 60.0, 64.0])
def test_a_segment_lacks_what_the_model_lacks_or_its_total_was_set_whatever_it_lacks(model: float) -> None:
    heard = hear_sum(said_by_forces(), model_kg=model, declared_kg=DECLARED_KG)
    bayes, _ = integrate(0.5 + 0.5 * weigh_reading(DECLARED_KG - model))
    assert heard.bayes == pytest.approx(bayes, abs=1e-6)
    sizes = [said_by_forces().size[0], integrate(weigh_reading(DECLARED_KG - model))[1]]
    assert min(abs(heard.size[0] - size) for size in sizes) < 1e-6  # that of the likelier of the two


@pytest.mark.parametrize(
    ("disagree", "trials", "first"),
    [
        (False, ("walk",), "plate_gain"),
        (True, ("walk",), "body_mass"),  # a mass of each recording, or a gain of one
        (True, (), "plate_gain"),  # one number for all recordings against a mass of each
    ],
)
def test_a_mass_of_each_recording_is_one_number_with_a_gain_there(
    disagree: bool, trials: tuple[str, ...], first: str
) -> None:
    gain = Ranked(9.0, Candidate(kind="plate_gain", where=("plate_1",), columns=(), trials=trials))
    bias = Ranked(2.0, Candidate(kind="plate_bias", where=("plate_1",), columns=()))
    mass, ranked = Ranked(7.0, Candidate(kind="body_mass", where=("world",), columns=())), [gain, bias]
    ranked.insert(place_mass(ranked, mass, disagree=disagree), mass)
    assert ranked[0].candidate.kind == first
    assert ranked[2] is bias
