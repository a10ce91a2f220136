"""Random recordings, and what reading a file comes to: shared by the tests of several formats."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from hypothesis import HealthCheck, settings

from scaling_service.core.errors import InputError
from scaling_service.model.trial import Trial

Read = TypeVar("Read")

SHARED_FOLDER = settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])


def random_trial(
    n: int, labels: Sequence[str], *, rate: float = 100.0, seed: int = 0, missing: float = 0.0
) -> Trial:
    """Markers anywhere within 2 m, a share of them not seen."""
    rng = np.random.default_rng(seed)
    markers = rng.uniform(-2, 2, (n, len(labels), 3))
    markers[rng.random(markers.shape[:2]) < missing] = np.nan
    return Trial(name="walk", times=np.arange(n) / rate, labels=tuple(labels), markers=markers, rate_hz=rate)


def outcome(read: Callable[[Path], Read], path: Path) -> Read | InputError:
    """What reading gives: a value, or the refusal; any other exception fails the test."""
    try:
        return read(path)
    except InputError as error:
        return error
