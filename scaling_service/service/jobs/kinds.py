"""The table of what can be asked for. A new capability is a folder with a request and its work, and a row."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from scaling_service.capabilities.cohort.document import CohortDocument
from scaling_service.capabilities.cohort.request import RECORD, BatchRequest, MemberRequest, MemberResult
from scaling_service.capabilities.consistent.document import ConsistentDocument
from scaling_service.capabilities.consistent.request import ConsistentRequest
from scaling_service.capabilities.discovery.document import DiscoveryDocument
from scaling_service.capabilities.discovery.request import DiscoverRequest
from scaling_service.capabilities.dynamics.document import DynamicsDocument
from scaling_service.capabilities.dynamics.request import DynamicsRequest
from scaling_service.capabilities.intake.document import ProofDocument
from scaling_service.capabilities.intake.request import ProofRequest
from scaling_service.capabilities.landmarks.document import LandmarksDocument
from scaling_service.capabilities.motion.request import MotionRequest
from scaling_service.capabilities.motion.saving import MotionDocument
from scaling_service.capabilities.scaling.comparison_request import (
    JointAnglesRequest,
    KinematicErrorRequest,
    SegmentLengthsRequest,
)
from scaling_service.capabilities.scaling.comparisons import (
    JointAngleComparison,
    KinematicErrorComparison,
    SegmentLengthComparison,
)
from scaling_service.capabilities.scaling.request import JobRequest, LandmarksRequest, ScalingRequest
from scaling_service.capabilities.scaling.single_request import LinearRequest, OptimisedRequest
from scaling_service.documents.results import ComparisonDocument, ScalingDocument
from scaling_service.service.sandbox.child import Progress

Work = Callable[[Any, Path, Path, Progress], Any]
"""Request, folder of inputs, folder of outputs, progress -> the result, JSON-ready.

The folder of inputs has one folder for each subject, with its document as ``subject.json`` and the
uploaded files beside it. What is written to the folder of outputs becomes the job's files.
"""


@dataclass(frozen=True, slots=True)
class Late:
    """A function of a capability, imported when it is called.

    Whoever only lists what can be asked for then needs a third of the memory.

    Parameters
    ----------
    module, name : str
        The module below ``capabilities``.
    """

    module: str
    name: str = "work"

    def __call__(self, request: Any, inputs: Path, outputs: Path, progress: Progress) -> Any:
        """Do the work."""
        return getattr(import_module(self.path), self.name)(request, inputs, outputs, progress)

    @property
    def path(self) -> str:
        """The module's whole name."""
        return f"scaling_service.capabilities.{self.module}"


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
        inputs. How the parts ended stands there, too (``PARTS``).
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
    work: Late
    route: str | None = ""
    result: type[BaseModel] | None = None
    parts: Parts | None = None


KINDS: Mapping[str, Kind] = {
    "proof": Kind(ProofRequest, Late("intake.work"), "proofs", ProofDocument),
    "linear-scaling": Kind(LinearRequest, Late("scaling.single_work"), "scalings/linear", ScalingDocument),
    "optimised-scaling": Kind(
        OptimisedRequest, Late("scaling.single_work"), "scalings/optimised", ScalingDocument
    ),
    "landmarks": Kind(LandmarksRequest, Late("landmarks.work"), "scalings/mesh-landmarks", LandmarksDocument),
    "scaling": Kind(ScalingRequest, Late("scaling.work"), "comparisons", ComparisonDocument),
    "kinematic-error": Kind(
        KinematicErrorRequest,
        Late("scaling.comparison_work", "kinematic_error"),
        "comparisons/kinematic-error",
        KinematicErrorComparison,
    ),
    "segment-lengths": Kind(
        SegmentLengthsRequest,
        Late("scaling.comparison_work", "segment_lengths"),
        "comparisons/segment-lengths",
        SegmentLengthComparison,
    ),
    "joint-angles": Kind(
        JointAnglesRequest,
        Late("scaling.comparison_work", "joint_angles"),
        "comparisons/joint-angles",
        JointAngleComparison,
    ),
    "motion": Kind(MotionRequest, Late("motion.work"), "motions", MotionDocument),
    "dynamics": Kind(DynamicsRequest, Late("dynamics.work"), "dynamics", DynamicsDocument),
    "consistent": Kind(ConsistentRequest, Late("consistent.work"), "consistent-motions", ConsistentDocument),
    "discovery": Kind(DiscoverRequest, Late("discovery.work"), "discoveries", DiscoveryDocument),
    "batch": Kind(
        BatchRequest,
        Late("cohort.work"),
        "batches",
        CohortDocument,
        Parts("batch-member", BatchRequest.members, RECORD),
    ),
    "batch-member": Kind(MemberRequest, Late("cohort.member_work"), None, MemberResult),
}
