"""What a cohort's statistics take of one subject: few numbers and mean curves, no recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from scaling_service.model.body import Vector

TRUTH = "truth"
"""Stands beside the methods' names where the true body is known."""


@dataclass(frozen=True, slots=True)
class Following:
    """How closely a method's model follows the markers of one trial, m.

    ``mean``, ``rms`` and ``max`` are over frames and markers; ``role`` is ``evaluation`` for a trial that
    was not used to fit.
    """

    role: Literal["calibration", "evaluation"]
    mean: float
    rms: float
    max: float


@dataclass(frozen=True, slots=True)
class MethodSummary:
    """One method's figures of one subject.

    Parameters
    ----------
    lengths : mapping
        ``inter_hip``, ``femur_r`` … to m. An image-based method has those that were imaged.
    trials : mapping
        Calibration and evaluation trial to how it is followed.
    knee_axes : mapping
        ``r``, ``l`` to the turns of the knee axis about x and y of the thigh, rad; as ``lengths``.
    marker_shifts : mapping
        Marker to how far the fit moved it, m; empty where the method fits no marker.
    curves : mapping
        Coordinate to its mean over the subject's strides, (n_nodes,), rad.
    from_truth_m, from_truth_rad : mapping
        What is measured (``lengths``, ``hip_centre``, ``hip_flexion`` …) to its distance from the truth.
    """

    lengths: Mapping[str, float] = field(default_factory=dict)
    trials: Mapping[str, Following] = field(default_factory=dict)
    knee_axes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    marker_shifts: Mapping[str, float] = field(default_factory=dict)
    curves: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    from_truth_m: Mapping[str, float] = field(default_factory=dict)
    from_truth_rad: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class SubjectSummary:
    """One subject's figures under all its methods.

    Parameters
    ----------
    subject : str
    methods : mapping
        In the order computed.
    true_lengths : mapping
        As ``lengths`` of a method; empty where the truth is not known.
    centres : mapping
        Reference (``EB`` or ``truth``) to method, the reference's own name among them, to joint, to where
        the method puts its centre in the reference's proximal segment, mean over frames, m.
    strides : mapping
        ``r``, ``l`` to the number of strides behind the curves.
    no_strides : mapping
        ``r``, ``l`` to why there are none.
    left_out : mapping
        Method to why it was not done.
    """

    subject: str
    methods: Mapping[str, MethodSummary]
    true_lengths: Mapping[str, float] = field(default_factory=dict)
    centres: Mapping[str, Mapping[str, Mapping[str, Vector]]] = field(default_factory=dict)
    strides: Mapping[str, int] = field(default_factory=dict)
    no_strides: Mapping[str, str] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
