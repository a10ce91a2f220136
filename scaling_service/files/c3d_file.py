"""C3D: what a binary recording holds.

A file states its layout several times: in its header, in its parameters and by its own length. Each of these
is one witness. The layout that most of them support and that the length allows is taken; where two are
supported equally well, the file is refused. The format is that of the C3D user guide (Motion Lab Systems,
2008).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import FileUnreadable, name_file
from scaling_service.files import c3d_layout, c3d_parameters
from scaling_service.files.tables import read_bytes
from scaling_service.model.trial import Repair

COMPUTED = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "MODELED_MARKERS")
"""Parameters of POINT in which Vicon Nexus lists the points that are results, not markers."""

_KIND = "a C3D file"
_POSE = 17  # numbers of one segment's pose: a 4x4 matrix, and how reliable it is


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class C3dFile:
    """What a C3D file holds, in its own units.

    ``parameters``: group to name to list of values; numeric arrays as nested lists, first index first.
    """

    name: str
    points: Array  # (n_frames, n_points, 3); in ``point_unit``; NaN where not seen
    labels: tuple[str, ...]  # empty where a point has none
    computed: frozenset[str]  # labels of points that are results (angles, moments, virtual points)
    point_unit: str
    rate_hz: float  # NaN where nothing states it
    analog: Array  # (n_samples, n_channels); scaled to the units of ``ANALOG:UNITS``
    parameters: Mapping[str, Mapping[str, Any]]
    descriptions: tuple[str, ...] = ()  # of the points, as far as they have any
    # (n_frames, n, 17): of segment poses (markerless systems) the 4x4 matrices, column by column, and how
    # reliable each is; None where the file has none
    poses: Array | None = None
    pose_labels: tuple[str, ...] = ()
    first: int = 1  # number of the first frame in the recording that it was cut from
    repairs: tuple[Repair, ...] = ()  # what its statements disagree on, and what was decided

    @property
    def analog_rate_hz(self) -> float:
        """Samples per second of the analog signals; NaN where there are none."""
        frames = len(self.points)
        return self.rate_hz * len(self.analog) / frames if frames and len(self.analog) else float("nan")


@name_file
def read_c3d_file(path: str | os.PathLike[str]) -> C3dFile:
    """Read everything that a C3D file holds, without judging it.

    Raises FileUnreadable if it is absent, empty, cut off, not C3D, or its statements of what it holds
    contradict each other beyond a decision. Raises TrialUnusable if it holds no frame.
    """
    file = Path(path)
    content = read_bytes(file, _KIND)
    # The second byte of every C3D file is 80 (C3D user guide, "Header section"); a header has 512 bytes.
    if len(content) < c3d_parameters.BLOCK or content[1] != 0x50:
        raise FileUnreadable("this is not a C3D file, or it is cut off", remedy="Export it again as C3D")
    facts = c3d_parameters.read_facts(content)
    poses = _read_poses(content, facts)
    of_layout: tuple[Repair, ...] = ()
    of_rate: tuple[Repair, ...] = ()
    if poses is not None and not (facts.points or facts.analogs):
        # Nothing but poses: there is no layout of points to be found.
        layout = c3d_layout.Layout(points=0, channels=0, per_frame=1, frames=0, start=1, real=True)
        rate, points, analog = (
            facts.number("ROTATION", "RATE"),
            np.empty((len(poses), 0, 3)),
            np.empty((0, 0)),
        )
        rate = rate if np.isfinite(rate) else facts.rate
    else:
        layout, of_layout = c3d_layout.find_layout(facts, len(content))
        rate, of_rate = c3d_layout.find_rate(facts, layout)
        points, analog = _decode(content, facts, layout)
    about = facts.parameters.get("POINT", {})

    def list_texts(name: str) -> tuple[str, ...]:
        texts = [str(text).strip() for text in c3d_parameters.join_numbered(about, name)][: layout.points]
        return tuple(texts + [""] * (layout.points - len(texts)))

    return C3dFile(
        name=file.stem,
        points=points,
        labels=list_texts("LABELS"),
        descriptions=list_texts("DESCRIPTIONS"),
        computed=frozenset(
            str(name).strip() for kind in COMPUTED for name in c3d_parameters.join_numbered(about, kind)
        )
        - {""},
        point_unit=str(c3d_parameters.take_first_value(about.get("UNITS")) or "").strip(),
        rate_hz=rate,
        analog=analog,
        parameters=facts.parameters,
        poses=poses,
        pose_labels=tuple(
            str(name).strip()
            for name in c3d_parameters.join_numbered(facts.parameters.get("ROTATION", {}), "LABELS")
        ),
        first=facts.count("TRIAL", "ACTUAL_START_FIELD") or facts.first,
        repairs=(*facts.repairs, *of_layout, *of_rate),
    )


def _read_poses(content: bytes, facts: c3d_parameters.Facts) -> Array | None:
    """The numbers of the group ROTATION (Has-Motion, C3D documentation, "ROTATION data type")."""
    if "ROTATION" not in facts.parameters:
        return None
    count, start = facts.count("ROTATION", "USED") or 0, facts.count("ROTATION", "DATA_START")
    ratio = facts.count("ROTATION", "RATIO") or 1
    frames = facts.count("ROTATION", "FRAMES") or facts.count("POINT", "FRAMES")
    frames = (frames or facts.last - facts.first + 1) * (1 if facts.count("ROTATION", "FRAMES") else ratio)
    if not count:
        return None
    at = c3d_parameters.BLOCK * ((start or facts.start) - 1)
    held = max(len(content) - at, 0) // (4 * _POSE * count)
    if frames < 1 or held < frames:
        raise FileUnreadable(
            f"the file is cut off: {frames} frames of {count} segment poses are stated, it holds {held}",
            field="ROTATION:DATA_START",
            remedy="Copy or export it again",
        )
    numbers = facts.processor.read_reals(content, at, frames * count * _POSE).astype(float)
    return numbers.reshape(frames, count, _POSE)[:: ratio if facts.points else 1]


def _decode(content: bytes, facts: c3d_parameters.Facts, layout: c3d_layout.Layout) -> tuple[Array, Array]:
    """Points (n_frames, n_points, 3), NaN where not seen, and analog signals (n_samples, n_channels)."""
    at, count = c3d_parameters.BLOCK * (layout.start - 1), layout.frames * layout.words
    if layout.real:
        numbers = facts.processor.read_reals(content, at, count)
    else:
        numbers = facts.processor.read_words(content, at, count, signed=True)
    table = numbers.reshape(layout.frames, layout.words)
    points = table[:, : 4 * layout.points].reshape(layout.frames, layout.points, 4).astype(float)
    xyz = points[..., :3] if layout.real else points[..., :3] * _find_scale(facts)
    seen = points[..., 3] >= 0  # the sign of the fourth number
    samples = layout.frames * layout.per_frame if layout.channels else 0
    analog = table[:, 4 * layout.points :].reshape(samples, layout.channels).astype(float)
    return np.where(seen[..., None], xyz, np.nan), _scale_analog(analog, facts)


def _find_scale(facts: c3d_parameters.Facts) -> float:
    """What one step of whole numbers is in units of length."""
    scales = [s for s in (facts.number("POINT", "SCALE"), facts.scale) if np.isfinite(s) and s > 0]
    if not scales or abs(scales[0] - scales[-1]) > c3d_layout.SAME * scales[0]:
        said = " and ".join(f"{s:g}" for s in scales) or "none"
        raise FileUnreadable(
            f"the scale of the points cannot be told: parameters and header state {said}",
            field="POINT:SCALE",
            remedy="Export it again",
        )
    return scales[0]


def _scale_analog(analog: Array, facts: c3d_parameters.Facts) -> Array:
    """Signals in the units of ANALOG:UNITS: (number - offset) · scale · general scale."""
    about = facts.parameters.get("ANALOG", {})
    channels = analog.shape[1]

    def list_values(name: str, usual: float) -> Array:
        values = [
            v
            for v in np.ravel(c3d_parameters.join_numbered(about, name)).tolist()
            if isinstance(v, int | float)
        ]
        return np.array((values + [usual] * channels)[:channels], float)

    offset, general = list_values("OFFSET", 0.0), facts.number("ANALOG", "GEN_SCALE")
    if str(c3d_parameters.take_first_value(about.get("FORMAT")) or "").upper().startswith("UNSIGNED"):
        analog, offset = np.where(analog < 0, analog + 65536.0, analog), offset % 65536
    scaled: Array = (analog - offset) * list_values("SCALE", 1.0) * (general if np.isfinite(general) else 1.0)
    return scaled
