"""What is too short to be searched, and what recordings are too short to decide, said before the search."""

from __future__ import annotations

from collections.abc import Sequence

from scaling_service.capabilities.discovery.evidence.fit import Recording
from scaling_service.core.errors import TrialUnusable
from scaling_service.model.trial import Trial
from scaling_service.numerics.signals.splines import MIN_SAMPLES

_AT_LEAST = 8
"""Stretches below which a person is told how much can be judged (chosen: an effect of three numbers then has
at most five degrees of freedom left)."""


def check_lengths(trials: Sequence[Trial]) -> None:
    """Refuse recordings that no acceleration can be told from.

    Raises
    ------
    TrialUnusable
        A trial has fewer frames than that takes.
    """
    for trial in trials:
        if trial.n_frames < MIN_SAMPLES:
            raise TrialUnusable(
                f"too few frames for a movement, {trial.n_frames}: accelerations take {MIN_SAMPLES} at least",
                file=trial.name,
                field="trials",
                remedy="Leave it out, or name a recording of standing under `static:`",
            )


def limits(recordings: Sequence[Recording], block_s: float) -> tuple[str, ...]:
    """Plain sentences on what cannot be decided.

    Parameters
    ----------
    recordings : sequence of Recording
    block_s : float
        Length of the stretches of time that count as independent, s.
    """
    lengths = [float(r.trial.times[-1] - r.trial.times[0]) for r in recordings if r.role == "fit"]
    count = sum(max(2, int(length / block_s)) for length in lengths)
    if count >= _AT_LEAST:
        return ()
    return (
        f"{sum(lengths):.1f} s to fit are {count} stretches of {block_s:g} s that count as independent: "
        "only strong effects can be told from chance, and hardly any from their likes",
    )
