"""Which recording shows the person standing still: the markers decide, a name only breaks ties."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.intake.files import RecordingFile
from scaling_service.capabilities.intake.markers import guess_segment
from scaling_service.core.errors import InputError
from scaling_service.model.anatomy import markers
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.problem import find_shown
from scaling_service.recording.exchanged import measure_shape
from scaling_service.recording.findings import name_landmarks
from scaling_service.recording.person import has_straight_legs
from scaling_service.recording.plausibility import find_unit_factor

STILL_M = 0.02
"""Chosen: markers of pelvis and legs of somebody who stands sway less than this (standard deviation; 1 to 10
mm in real recordings, 50 mm and more of a leg that moves)."""

FIDGETS_M = 0.05
"""Chosen: a recording that its name calls standing is taken up to this, where none is stiller."""

STOOD_S = 0.5
"""Chosen: in a shorter recording anything stands still, so that only landmarks or a name tell that somebody
does."""

STANDING = re.compile(r"stat|stand|steh|neutral|anat|pose$|tpose|apose")
"""How a word of a standing recording's name begins."""

ANOTHER_PELVIS = 0.08
"""Chosen: relative difference of the pelvis' width and depth between standing and moving beyond which
markers were put on anew; skin moves those of real recordings by less than 5 %."""

_BELOW = ("pelvis", "femur", "tibia", "calcn")
_MOST = 0.9  # chosen: of somebody who moves one foot, more markers of the legs move
_FREE = 0.4  # chosen: arms and head of somebody who stands move 2.5 times as far as legs
_STEP_M = 0.002  # chosen: sway that differs by less is equal


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """How a recording would do as the static trial."""

    file: str
    sway_m: float
    landmarks: int  # that are seen in it
    frames: int
    lasts_s: float
    pelvis: float  # the pelvis' size over that in the movements; 1 where that is not known
    upright: bool  # whether the legs are straight, as far as that is known
    named: bool  # whether its name says standing

    @property
    def still(self) -> bool:
        """Whether somebody stands in it."""
        if self.lasts_s < STOOD_S and not (self.landmarks or self.named):
            return False
        return self.sway_m < (FIDGETS_M if self.named else STILL_M)

    @property
    def agrees(self) -> bool:
        """Whether the pelvis is that of the movements."""
        return abs(self.pelvis - 1.0) <= ANOTHER_PELVIS

    @property
    def merit(self) -> tuple[bool, bool, bool, int, int]:
        """The largest is the best: straight legs, the movements' pelvis, still, most landmarks, stillest."""
        stillness = -int(self.sway_m / _STEP_M)
        return (self.upright, self.agrees, self.sway_m < STILL_M, self.landmarks, stillness)

    @property
    def why(self) -> str:
        """In words."""
        still = f"pelvis and legs move by less than {max(1e3 * self.sway_m, 1.0):.0f} mm"
        return f"{still}, {self.landmarks} landmarks are seen"


def split_into_words(name: str) -> list[str]:
    """The words of a file's name, in small letters: cut at signs, digits and capitals.

    Examples
    --------
    >>> split_into_words("S01_staticTrial2.c3d")
    ['s', 'static', 'trial']
    """
    stem = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name.rpartition(".")[0])
    return re.findall(r"[^\W\d_]+", stem.lower())


def in_metres(seen_: RecordingFile) -> Trial:
    """The recording with its unit corrected; as stated where that cannot be told."""
    try:
        factor, _ = find_unit_factor(seen_.trial)
    except InputError:
        return seen_.trial
    return seen_.trial if factor == 1.0 else seen_.trial.with_markers(seen_.trial.markers * factor)


def sort_by_segment(labels: Sequence[str]) -> dict[str, list[str]]:
    """Segment to the labels that are known to sit on it, by marker sets or words, computed points left out.

    Examples
    --------
    >>> sort_by_segment(["RASI", "LASI", "RTHI", "R_thigh9", "RFEO", "odd"])
    {'pelvis': ['RASI', 'LASI'], 'femur_r': ['RTHI', 'R_thigh9']}
    """
    found: dict[str, list[str]] = {}
    for label in labels:
        meant = markers.look_up_meaning(label)
        segment = guess_segment(label) if meant is None else meant.segment
        if segment is None or markers.is_computed(label):
            continue
        if meant is not None and meant.side and segment not in ("pelvis", "torso", "head"):
            segment = f"{segment}_{meant.side}"
        found.setdefault(segment, []).append(label)
    return found


def rank_standing(recordings: Sequence[RecordingFile]) -> list[Standing]:
    """How each recording would do as the static trial, the best first."""
    trials = {item.file: in_metres(item) for item in recordings}
    sways = {file: measure_sway(trial) for file, trial in trials.items()}
    moving = [trial for file, trial in trials.items() if sways[file] >= FIDGETS_M]
    found = [
        Standing(
            file=file,
            sway_m=sways[file],
            landmarks=len({markers.find_canonical(label) for label in trial.shown_labels} - {None}),
            frames=trial.n_frames,
            lasts_s=float(trial.times[-1] - trial.times[0]),
            pelvis=compare_pelvis(trial, moving),
            upright=has_straight_legs(trial),
            named=any(STANDING.match(word) for word in split_into_words(file)),
        )
        for file, trial in trials.items()
    ]
    return sorted((s for s in found if s.still), key=lambda s: (s.merit, s.named, s.frames), reverse=True)


def measure_sway(trial: Trial) -> float:
    """Standard deviation of a marker's place, m, that nine of ten markers of pelvis and legs stay below.

    Trunk and arms may move farther; where no label is known to sit on the legs, all markers count.
    """
    clusters = sort_by_segment(trial.labels)
    legs = {label for segment, on in clusters.items() if segment.startswith(_BELOW) for label in on}
    shown = find_shown(trial.markers)
    if trial.n_frames < 2 or not shown.any():
        return 0.0
    spread = np.full(len(trial.labels), np.nan)
    spread[shown] = np.linalg.norm(np.nanstd(trial.markers[:, shown], axis=0), axis=-1)
    on_legs = spread[shown & [label in legs for label in trial.labels]]
    every = float(np.nanquantile(spread, _MOST))
    return max(float(np.quantile(on_legs, _MOST)), _FREE * every) if len(on_legs) else every


def compare_pelvis(trial: Trial, others: Sequence[Trial]) -> float:
    """The median of the pelvis' distances in one recording over those in others; 1 where none is known."""
    own, theirs = _list_pelvis_distances([trial]), _list_pelvis_distances(others)
    ratios = [own[pair] / theirs[pair] for pair in own if theirs.get(pair, 0.0) > 0.0]
    return float(np.median(ratios)) if ratios else 1.0


def _list_pelvis_distances(trials: Sequence[Trial]) -> dict[tuple[str, str], float]:
    """Usual distances between the pelvis' landmarks, by landmark."""
    return measure_shape(
        map(name_landmarks, trials), {"pelvis": ("RASIS", "LASIS", "RPSIS", "LPSIS", "SACR")}
    )
