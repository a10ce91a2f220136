"""Requests for one view of a comparison of methods."""

from __future__ import annotations

from scaling_service.capabilities.scaling.request import ScalingRequest


class KinematicErrorRequest(ScalingRequest):
    """Compare how closely the methods' models follow the markers, on recordings fitted and held out."""


class SegmentLengthsRequest(ScalingRequest):
    """Compare the segment lengths and joint centres of the methods' models."""


class JointAnglesRequest(ScalingRequest):
    """Compare the joint angles that the methods' models give in the same recordings."""
