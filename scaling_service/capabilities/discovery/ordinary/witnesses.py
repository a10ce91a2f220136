"""What is known of a person's mass beside the plates: the declared one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from scaling_service.capabilities.discovery.ordinary.odds import Scored

DECLARED = 0.025
"""Of a declared mass (chosen: clothes, shoes and an old value make 2 to 5 %)."""


def hear_declared(load: Scored, *, borne_kg: float, declared_kg: float) -> Scored:
    """A carried load with what was declared: what is carried is not the person's own.

    Parameters
    ----------
    load : Scored
        Its first number is its mass.
    borne_kg : float
        What the plates bear, less loads that are named.
    """
    return _hear(load, borne_kg - declared_kg, DECLARED * declared_kg)


def hear_sum(mass: Scored, *, model_kg: float, declared_kg: float) -> Scored:
    """A segment's mass with what was declared: the others and it weigh that together.

    Or the model was given the declared sum, whatever its segments are: both are as likely beforehand.

    Parameters
    ----------
    mass : Scored
        What the segment lacks, kg.
    model_kg : float
        What the model's segments weigh together.
    """
    heard = _hear(mass, declared_kg - model_kg, DECLARED * declared_kg)
    share = 1.0 / (1.0 + math.exp(min(mass.bayes - heard.bayes, 700.0)))
    if share < 0.5:
        return replace(mass, bayes=mass.bayes + math.log(0.5 / (1.0 - share)))
    return replace(heard, bayes=heard.bayes + math.log(0.5 / share))


def _hear(one: Scored, value: float, sd: float) -> Scored:
    """With a reading of its first number."""
    spread, alone = one.covariance[:, 0], sd**2
    told, missed = float(spread[0]) + alone, value - float(one.size[0])
    bayes = 0.5 * (value**2 / alone + math.log(alone) - missed**2 / told - math.log(told))
    information = one.information.copy()
    information[0, 0] += 1.0 / alone
    return replace(
        one,
        bayes=one.bayes + bayes,
        size=one.size + spread * missed / told,
        covariance=one.covariance - np.outer(spread, spread) / told,
        information=information,
    )
