"""The table of what can be asked for. A new capability is a module under ``work``, a request, and a row."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from scaling_service.runner.child import Progress
from scaling_service.runner.cohort_request import BatchRequest
from scaling_service.runner.comparing import JointAnglesRequest, KinematicErrorRequest, SegmentLengthsRequest
from scaling_service.runner.requests import JobRequest, LandmarksRequest, ScalingRequest
from scaling_service.runner.single import LinearRequest, OptimisedRequest
from scaling_service.schemas.cohort import CohortDocument
from scaling_service.schemas.comparisons import (
    JointAngleComparison,
    KinematicErrorComparison,
    SegmentLengthComparison,
)
from scaling_service.schemas.landmarks import LandmarksDocument
from scaling_service.schemas.results import ComparisonDocument, ScalingDocument

Work = Callable[[Any, Path, Path, Progress], Any]
"""Request, folder of inputs, folder of outputs, progress -> the result, JSON-ready.

The folder of inputs has one folder for each subject, with its document as ``subject.json`` and the
uploaded files beside it. What is written to the folder of outputs becomes the job's files.
"""


@dataclass(frozen=True, slots=True)
class Late:
    """A function in :mod:`scaling_service.runner.work`, imported when it is called.

    Whoever only lists what can be asked for then needs a third of the memory.

    Parameters
    ----------
    module, name : str
    """

    module: str
    name: str = "work"

    def __call__(self, request: Any, inputs: Path, outputs: Path, progress: Progress) -> Any:
        """Do the work."""
        module = import_module(f"{__package__}.work.{self.module}")
        return getattr(module, self.name)(request, inputs, outputs, progress)


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of job.

    Parameters
    ----------
    request : type
        What is asked for; its fields are the body over HTTP.
    work : callable
        A function that can be named from another process; it runs there.
    route : str
        Where it is asked for over HTTP, below the version; the kind's name unless given.
    result : type, optional
        What the result follows.
    """

    request: type[JobRequest]
    work: Work
    route: str = ""
    result: type[BaseModel] | None = None


KINDS: Mapping[str, Kind] = {
    "linear-scaling": Kind(LinearRequest, Late("single"), "scalings/linear", ScalingDocument),
    "optimised-scaling": Kind(OptimisedRequest, Late("single"), "scalings/optimised", ScalingDocument),
    "landmarks": Kind(LandmarksRequest, Late("landmarks"), "scalings/mesh-landmarks", LandmarksDocument),
    "scaling": Kind(ScalingRequest, Late("scaling"), "comparisons", ComparisonDocument),
    "kinematic-error": Kind(
        KinematicErrorRequest,
        Late("comparing", "kinematic_error"),
        "comparisons/kinematic-error",
        KinematicErrorComparison,
    ),
    "segment-lengths": Kind(
        SegmentLengthsRequest,
        Late("comparing", "segment_lengths"),
        "comparisons/segment-lengths",
        SegmentLengthComparison,
    ),
    "joint-angles": Kind(
        JointAnglesRequest,
        Late("comparing", "joint_angles"),
        "comparisons/joint-angles",
        JointAngleComparison,
    ),
    "batch": Kind(BatchRequest, Late("batch"), "batches", CohortDocument),
}
