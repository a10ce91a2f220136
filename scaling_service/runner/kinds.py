"""The table of what can be asked for. A new capability is a module under ``work``, a request, and a row."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from scaling_service.capabilities.motion.result import MotionDocument
from scaling_service.runner.child import Progress
from scaling_service.runner.cohort_request import RECORD, BatchRequest, MemberRequest, MemberResult
from scaling_service.runner.comparing import JointAnglesRequest, KinematicErrorRequest, SegmentLengthsRequest
from scaling_service.runner.consistent_request import ConsistentRequest
from scaling_service.runner.discover_request import DiscoverRequest
from scaling_service.runner.dynamics_request import DynamicsRequest
from scaling_service.runner.motion_request import MotionRequest
from scaling_service.runner.proof_request import ProofRequest
from scaling_service.runner.requests import JobRequest, LandmarksRequest, ScalingRequest
from scaling_service.runner.single import LinearRequest, OptimisedRequest
from scaling_service.schemas.cohort import CohortDocument
from scaling_service.schemas.comparisons import (
    JointAngleComparison,
    KinematicErrorComparison,
    SegmentLengthComparison,
)
from scaling_service.schemas.consistent import ConsistentDocument
from scaling_service.schemas.discovery import DiscoveryDocument
from scaling_service.schemas.dynamics import DynamicsDocument
from scaling_service.schemas.landmarks import LandmarksDocument
from scaling_service.schemas.proof import ProofDocument
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
class Parts:
    """How a job is made of others, which any runner computes at any time; its own work comes after them.

    Parameters
    ----------
    kind : str
        Of the parts.
    requests : callable
        From the request to those of the parts; each concerns subjects of the whole.
    file : str
        Name of the file of each part that the work needs: it lies where the part wrote it, but among the
        inputs. How the parts ended stands there, too (:data:`~scaling_service.runner.names.PARTS`).
        All files of the parts become files of the whole.
    """

    kind: str
    requests: Callable[[Any], Sequence[JobRequest]]
    file: str


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of job.

    Parameters
    ----------
    request : type
        What is asked for; its fields are the body over HTTP.
    work : callable
        A function that can be named from another process; it runs there.
    route : str, optional
        Where it is asked for over HTTP, below the version; the kind's name where it is empty. None: it is
        a part of others only.
    result : type, optional
        What the result follows.
    parts : Parts, optional
        Where it is made of others. Its work then sees the subjects' documents, but not their files.
    """

    request: type[JobRequest]
    work: Work
    route: str | None = ""
    result: type[BaseModel] | None = None
    parts: Parts | None = None


KINDS: Mapping[str, Kind] = {
    "proof": Kind(ProofRequest, Late("proof"), "proofs", ProofDocument),
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
    "motion": Kind(MotionRequest, Late("motion"), "motions", MotionDocument),
    "dynamics": Kind(DynamicsRequest, Late("dynamics"), "dynamics", DynamicsDocument),
    "consistent": Kind(ConsistentRequest, Late("consistent"), "consistent-motions", ConsistentDocument),
    "discovery": Kind(DiscoverRequest, Late("discover"), "discoveries", DiscoveryDocument),
    "batch": Kind(
        BatchRequest,
        Late("batch"),
        "batches",
        CohortDocument,
        Parts("batch-member", BatchRequest.members, RECORD),
    ),
    "batch-member": Kind(MemberRequest, Late("member"), None, MemberResult),
}
