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
    value, alone = borne_kg - declared_kg, (DECLARED * declared_kg) ** 2
    spread = load.covariance[:, 0]
    told, missed = float(spread[0]) + alone, value - float(load.size[0])
    bayes = 0.5 * (value**2 / alone + math.log(alone) - missed**2 / told - math.log(told))
    information = load.information.copy()
    information[0, 0] += 1.0 / alone
    return replace(
        load,
        bayes=load.bayes + bayes,
        size=load.size + spread * missed / told,
        covariance=load.covariance - np.outer(spread, spread) / told,
        information=information,
    )
