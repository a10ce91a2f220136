"""What a declared mass says of a load and of a segment's mass, against integrals over a grid."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.stats import norm

from scaling_service.capabilities.discovery.ordinary.odds import Scored
from scaling_service.capabilities.discovery.ordinary.witnesses import DECLARED, hear_declared, hear_sum

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
