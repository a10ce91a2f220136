"""Whether what an OpenSim scale set-up measures can be measured on a recording."""

from __future__ import annotations

from collections import abc
from pathlib import Path

import numpy as np

from scaling_service.core.errors import TrialUnusable
from scaling_service.core.notes import Note
from scaling_service.core.text import list_few
from scaling_service.model.body import BodyModel
from scaling_service.model.subject import ScaleSetup
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.problem import find_seen

_MARGIN_S = 1e-9  # as calibration takes the frames of a time range


def require_measurements(setup: ScaleSetup, model: BodyModel, trial: Trial, file: Path) -> abc.Iterator[Note]:
    """Refuse a scale set-up whose measurements cannot be taken, and say what it scales without effect.

    ``trial``: the one that lengths are measured on. ``file``: the set-up. Raises TrialUnusable: a
    measurement's marker is not in the model or never seen, or the time range holds no frame.
    """
    if setup.time_range is None:
        rows = slice(None)
    else:
        start, end = setup.time_range
        if start > trial.times[-1] + _MARGIN_S or end < trial.times[0] - _MARGIN_S:
            raise TrialUnusable(
                f"trial '{trial.name}' lasts from {trial.times[0]:g} to {trial.times[-1]:g} s and has no "
                f"frame between {start:g} and {end:g} s",
                file=file,
                field="ModelScaler.time_range",
                remedy="Correct the time range in the scale set-up",
            )
        first, last = np.searchsorted(trial.times, (start - _MARGIN_S, end + _MARGIN_S))
        rows = slice(int(first), max(int(last), int(first) + 1))
    within = trial.frames(rows)
    for measurement, pair in ((m, pair) for m in setup.measurements for pair in m.pairs):
        for name in pair:
            if name not in model.marker_names:
                raise TrialUnusable(
                    f"it uses marker '{name}', which the model does not have",
                    file=file,
                    field=f"measurement {measurement.name}",
                    remedy="Give the marker set that belongs to the set-up under `marker_set:`",
                )
            within.index(name)
        if not (find_seen(within.position(pair[0])) & find_seen(within.position(pair[1]))).any():
            raise TrialUnusable(
                f"markers '{pair[0]}' and '{pair[1]}', between which '{measurement.name}' is measured, are "
                f"never seen together in trial '{trial.name}'",
                file=trial.name,
                field=f"{pair[0]}, {pair[1]}",
                remedy="Label them in the recording, or take the measurement out of the scale set-up",
            )
    scaled = [*(s for m in setup.measurements for s in m.axes), *setup.manual]
    unknown = [name for name in dict.fromkeys(scaled) if name not in model.segment_names]
    if unknown:
        yield Note(
            code="scaled_unknown",
            problem=f"{file.name} scales {list_few(unknown)}, which the model does not have: "
            "that was left out",
            remedy="Correct the scale set-up if it matters",
        )
