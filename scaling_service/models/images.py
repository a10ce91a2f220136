"""What images say of a person: joint centres, axes, landmarks on bone, markers on skin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from scaling_service.models.body import Vector


@dataclass(frozen=True, slots=True)
class ImageEvidence:
    """Points of one image session, all in its frame, m.

    Parameters
    ----------
    centres : mapping
        ``hip_r``, ``knee_r``, ``ankle_r`` and the left ones, as far as imaged.
    axes : mapping
        ``knee_r``, ``knee_l``: direction of the flexion axis, either way round.
    landmarks : mapping
        Points on bone by the name of the marker that is put on them (``RASIS``, ``RLFE`` …).
    markers : mapping
        Skin markers seen in the image: model marker to (segment, position).
    source : str
        How they were found.
    """

    centres: Mapping[str, Vector] = field(default_factory=dict)
    axes: Mapping[str, Vector] = field(default_factory=dict)
    landmarks: Mapping[str, Vector] = field(default_factory=dict)
    markers: Mapping[str, tuple[str, Vector]] = field(default_factory=dict)
    source: str = ""

    def sides(self) -> tuple[str, ...]:
        """The legs of which hip, knee and ankle centre are known."""
        return tuple(
            s for s in "rl" if all(f"{joint}_{s}" in self.centres for joint in ("hip", "knee", "ankle"))
        )
