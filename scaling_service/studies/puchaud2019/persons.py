"""Who the study's virtual persons are, how it differs from the paper, and CusToM's legs to start from.

CusToM is the paper's toolbox.

The paper does not print its generic model; the built-in one has its subjects' mean proportions. Joint
centres and markers below are those of CusToM's leg (files PelvisNoTrunk, Thigh, Shank), at its stature of
1.80 m, brought to this cohort's. Its pelvis is wide and its hip centres narrow for its markers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from scaling_service.capabilities.cohort.outcomes import Done
from scaling_service.capabilities.cohort.summary import Truth, summarise
from scaling_service.capabilities.scaling.methods.placement import move_markers, with_centre
from scaling_service.capabilities.scaling.run import run
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.core.progress import Progress
from scaling_service.model.body import BodyModel, Vector
from scaling_service.model.builtin import generic_person
from scaling_service.virtual.subject import VirtualSettings, demo_session

SUBJECTS = 26
"""Puchaud 2019, section 2.1."""

WALKERS = 6
"""Of them, those whose gait was recorded (section 2.1)."""

DIFFERENCES = (
    "The persons are virtual. Their statures, bone lengths and knee axes are drawn from the paper's own "
    "means and scatter; palpation, skin movement and images have the sizes that the literature gives. None "
    "was adjusted until a table fitted.",
    "The paper does not print its generic model. The built-in one has the mean proportions of the paper's "
    "subjects, and its markers sit where these persons have them on average: MB then errs less than in the "
    "paper, and differences in lengths are too small to be found. --generic custom starts from the legs of "
    "the published toolbox instead, whose markers sit elsewhere: the methods then differ far more.",
    "All persons walk here. Six subjects, averaged over their strides, are too few for a test by permutation "
    "to decide any pair of models; the paper counted twelve cycles of six subjects as twelve observations.",
    "The paper takes EB for the truth, but an image has errors, too. Here the truth is known, and each "
    "model's distance from it is shown beside.",
)
"""How this study is not the paper's, in plain English."""

Generic = Literal["custom", "mean"]
"""The legs of CusToM, or the built-in ones, which have the mean proportions of the paper's subjects."""

_STATURE_M = 1.80

_MARKERS: Mapping[str, Vector] = {
    "ASIS": (0.0, 0.0, 0.140),
    "PSIS": (-0.1703, 0.0, 0.040),
    "LFE": (-0.0206, -0.467, 0.073),
    # On the shank in CusToM, on the thigh in table 1: its place at full extension.
    "MFE": (-0.025, -0.4842, -0.046),
    # In none of its leg files: TLEM's bone point, 12 mm of skin and marker beside it.
    "FH": (-0.020, -0.055, 0.055),
    "LM": (0.0, -0.4692, 0.0415),
    "MM": (0.020, -0.4481, -0.040),
    "AJC": (0.0, -0.460, 0.0),
}
"""Right side in the segment's frame, m: mid-ASIS, hip centre, knee centre."""

_CENTRES: Mapping[str, Vector] = {"femur": (-0.0843, -0.0651, 0.080), "tibia": (-0.025, -0.455, 0.010)}
"""Of the right hip in the pelvis and the right knee in the thigh, m."""


@dataclass(frozen=True, slots=True)
class VirtualPerson:
    """A person drawn from the literature's spread, truth known; with or without images.

    ``generic`` says what scaling starts from.
    """

    seed: int
    settings: VirtualSettings = field(default_factory=VirtualSettings)
    groups: Mapping[str, str] = field(default_factory=dict)
    images: bool = False
    generic: Generic = "mean"

    @property
    def name(self) -> str:
        """``virtual_<seed>``."""
        return f"virtual_{self.seed}"

    @property
    def shown(self) -> str:
        """There is no file."""
        return self.name

    def work(self, methods: Sequence[str] | None, settings: Settings, progress: Progress) -> Done:
        """Record the person, and scale."""
        session, person = demo_session(self.seed, self.settings, images=self.images)
        if self.generic == "custom":
            session = replace(session, model=custom_legs(session.model))
        results = run(Loaded(session), methods, settings, progress=progress)
        return Done(summarise(results, Truth(person.model, person.motions)))


def custom_legs(mean: BodyModel) -> BodyModel:
    """The built-in ``lower_limb_14dof`` with joint centres and markers where CusToM's legs have them."""
    k = generic_person(mean.name).height_m / _STATURE_M
    local = {
        f"{letter}{name}": _sided(place, k, side)
        for name, place in _MARKERS.items()
        for letter, side in (("R", 1.0), ("L", -1.0))
    }
    model = move_markers(mean, local)
    for segment, place in _CENTRES.items():
        for letter, side in (("r", 1.0), ("l", -1.0)):
            model = with_centre(model, f"{segment}_{letter}", _sided(place, k, side))
    return replace(model, name=f"{mean.name}, as CusToM")


def _sided(place: Vector, k: float, side: float) -> Vector:
    x, y, z = place
    return (k * x, k * y, k * side * z)
