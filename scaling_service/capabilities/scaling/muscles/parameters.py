"""Muscles' fibres and tendons such that each works over the range that it has in the generic model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.files.osim import muscles
from scaling_service.files.osim.models import read_osim
from scaling_service.model.body import BodyModel
from scaling_service.model.muscles import Muscle
from scaling_service.model.poses import sweep_coordinates

_STEPS = 10  # of each coordinate's range (Modenese et al. 2016 took ten)
_WORKING = (0.5, 1.5)
"""Optimal lengths between which a fibre's poses count (Modenese et al. 2016)."""
_LEAST_RANGE = 0.01  # of a fibre's length; chosen: less tells fibre and tendon not apart


def keep_ranges(osim: str, model: BodyModel, source: Path) -> tuple[str, tuple[str, ...]]:
    """The text of a scaled model whose fibres work as the generic ones do, and muscles that kept their ratio.

    In every pose fibre and tendon together are to be as long as the muscle while the fibre has the generic
    one's normalised length: least squares in optimal fibre and tendon slack length over sweeps of every
    coordinate. Tendons are rigid, so that both follow from the line of scaled lengths over generic ones.
    Muscles that hardly change their length, or whose line gives no tendon, keep their ratio.

    ``osim``, ``model``: the scaled model's text and what it holds. ``source``: the generic ``.osim`` file.
    Source: Modenese, Ceseracciu, Reggiani and Lloyd 2016, J Biomech 49, 141-148; their tendons stretch.
    Raises DependencyMissing, FileUnreadable, ModelRefused: as for reading a model.
    """
    generic, text = read_osim(source), source.read_text(encoding="utf-8")
    q = np.concatenate(list(sweep_coordinates(generic, _STEPS).values()))
    same = q[:, [generic.coordinate_names.index(name) for name in model.coordinate_names]]
    before, after = muscles.measure_muscles(text, generic, q), muscles.measure_muscles(osim, model, same)
    order = [after.muscles.index(name) for name in before.muscles]
    found, kept = {}, []
    for k, muscle in enumerate(muscles.read_musculature(text, generic, q[:1]).muscles):
        fitted = fit_lengths(muscle, before.lengths[:, k], after.lengths[:, order[k]])
        if fitted is None:
            kept.append(muscle.name)
        else:
            found[muscle.name] = fitted
    return muscles.set_parameters(osim, model, found), tuple(kept)


def fit_lengths(muscle: Muscle, before: Array, after: Array) -> Sequence[float] | None:
    """Optimal fibre and tendon slack length, m, of a scaled muscle; None: its lengths do not tell them.

    ``muscle``: the generic one. ``before``, ``after``: lengths with the tendon in the same poses, (n,), m.
    """
    along = muscle.fibre * np.cos(muscle.pennation)
    fibre = (before - muscle.slack) / along  # along the tendon, in optimal lengths
    working = (fibre >= _WORKING[0]) & (fibre <= _WORKING[1])
    if not working.any() or np.ptp(fibre[working]) < _LEAST_RANGE:
        return None
    rows = np.column_stack([fibre[working], np.ones(int(working.sum()))])
    length, slack = np.linalg.lstsq(rows, after[working], rcond=None)[0]
    if min(length, slack) <= 0.0:
        return None
    return float(length / np.cos(muscle.pennation)), float(slack)
