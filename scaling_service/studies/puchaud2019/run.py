"""Puchaud et al. 2019 done again on virtual persons: who they are, and what becomes of them.

CusToM is the paper's toolbox. The paper does not print its generic model; the built-in one has its subjects'
mean proportions. Joint centres and markers below are those of CusToM's leg (files PelvisNoTrunk, Thigh,
Shank), at its stature of 1.80 m, brought to this cohort's. Its pelvis is wide and its hip centres narrow for
its markers.
"""

from __future__ import annotations

import dataclasses
import time
from collections import abc
from typing import Literal

from scaling_service.capabilities.cohort import summary as cohort_summary
from scaling_service.capabilities.cohort.executors import workers
from scaling_service.capabilities.cohort.outcomes import Done, run_members
from scaling_service.capabilities.cohort.run import Watcher
from scaling_service.capabilities.cohort.statistics import compute_cohort_statistics
from scaling_service.capabilities.scaling.methods import placement
from scaling_service.capabilities.scaling.run import run
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.preparing import Loaded
from scaling_service.core.errors import InputError
from scaling_service.core.progress import Progress
from scaling_service.core.threads import count_cores
from scaling_service.documents.writing import code_version
from scaling_service.model import body
from scaling_service.model.builtin import load_generic_person
from scaling_service.studies import claims
from scaling_service.studies.puchaud2019 import result as documents
from scaling_service.studies.puchaud2019.claims import CLAIMS
from scaling_service.virtual.example import make_demo_session
from scaling_service.virtual.subject import VirtualSettings

SUBJECTS = 26
"""Puchaud 2019, section 2.1."""

WALKERS = 6
"""Of them, those whose gait was recorded (section 2.1)."""

Generic = Literal["custom", "mean"]
"""The legs of CusToM, or the built-in ones, which have the mean proportions of the paper's subjects."""

_STATURE_M = 1.80

_MARKERS: abc.Mapping[str, body.Vector] = {
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

_CENTRES: abc.Mapping[str, body.Vector] = {
    "femur": (-0.0843, -0.0651, 0.080),
    "tibia": (-0.025, -0.455, 0.010),
}
"""Of the right hip in the pelvis and the right knee in the thigh, m."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class VirtualPerson:
    """A person drawn from the literature's spread, truth known; with or without images.

    ``generic`` says what scaling starts from.
    """

    seed: int
    settings: VirtualSettings = dataclasses.field(default_factory=VirtualSettings)
    groups: abc.Mapping[str, str] = dataclasses.field(default_factory=dict)
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

    def work(self, methods: abc.Sequence[str] | None, settings: Settings, progress: Progress) -> Done:
        """Record the person, and scale."""
        session, person = make_demo_session(self.seed, self.settings, images=self.images)
        if self.generic == "custom":
            session = dataclasses.replace(session, model=make_custom_legs(session.model))
        results = run(Loaded(session=session), methods, settings, progress=progress)
        return Done(cohort_summary.summarise(results, cohort_summary.Truth(person.model, person.motions)))


def make_custom_legs(mean: body.BodyModel) -> body.BodyModel:
    """The built-in ``lower_limb_14dof`` with joint centres and markers where CusToM's legs have them."""
    k = load_generic_person(mean.name).height_m / _STATURE_M
    local = {
        f"{letter}{name}": _mirror_side(place, k, side)
        for name, place in _MARKERS.items()
        for letter, side in (("R", 1.0), ("L", -1.0))
    }
    model = placement.move_markers(mean, local)
    for segment, place in _CENTRES.items():
        for letter, side in (("r", 1.0), ("l", -1.0)):
            model = placement.with_centre(model, f"{segment}_{letter}", _mirror_side(place, k, side))
    return dataclasses.replace(model, name=f"{mean.name}, as CusToM")


def _mirror_side(place: body.Vector, k: float, side: float) -> body.Vector:
    x, y, z = place
    return (k * x, k * y, k * side * z)


def reproduce_puchaud2019(
    settings: Settings = Settings(),
    *,
    subjects: int | None = None,
    generic: Generic = "mean",
    worker_count: int | None = None,
    watcher: Watcher | None = None,
) -> documents.Puchaud2019Document:
    """Scale virtual persons by the five methods of Puchaud et al. 2019, and ask what the paper claims.

    ``settings``: its seed decides who the persons are. ``subjects``: more than the six whose gait is also
    looked at alone; the paper's 26 unless given. ``generic``: the model that scaling starts from. Results do
    not depend on ``worker_count``. InputError: too few subjects, or a person that could not be scaled.
    """
    count = SUBJECTS if subjects is None else subjects
    if count <= WALKERS:
        raise InputError(
            f"{count} subjects are too few", field="--subjects", remedy=f"Take at least {WALKERS + 1}"
        )
    clock = time.perf_counter()
    settings = settings.model_copy(
        update={"calibration": settings.calibration.model_copy(update={"sizes": "measured"})}
    )  # as the paper
    people = [
        VirtualPerson(seed=seed, images=True, generic=generic)
        for seed in claims.draw_person_seeds(settings.seed, count)
    ]
    processes = min(worker_count or count_cores(), count)
    if watcher is not None:
        watcher.start(count, processes)
    with workers(processes, None if watcher is None else watcher.stage) as executor:
        outcomes = run_members(
            people,
            executor,
            documents.METHODS,
            settings,
            finished=None if watcher is None else watcher.finish,
        )
    slowest = max(outcome.wall_s for outcome in outcomes)
    # A study with a person missing is another study
    for outcome in outcomes:
        if outcome.status != "done":
            raise InputError(
                f"{outcome.name} could not be scaled: {outcome.reason}",
                field="--seed",
                remedy="Take another seed, and report this one",
            )
    return build_document(
        [outcome.summary for outcome in outcomes if outcome.summary is not None],
        settings,
        generic=generic,
        slowest_s=slowest,
        started=clock,
    )


def build_document(
    summaries: abc.Sequence[cohort_summary.SubjectSummary],
    settings: Settings,
    *,
    generic: Generic = "mean",
    slowest_s: float,
    started: float,
) -> documents.Puchaud2019Document:
    """Compare the methods over all persons and over the walkers alone, and ask what the paper claims.

    ``slowest_s``: the most time that one person's models took. ``started``: by ``time.perf_counter``.
    """
    everybody, walkers = (
        compute_cohort_statistics(some, documents.METHODS, seed=settings.seed)
        for some in (summaries, summaries[:WALKERS])
    )
    document = documents.Puchaud2019Document(
        source=" ".join(documents.read_paper()["source"].split()),
        code_version=code_version(),
        settings={**settings.resolved(), "generic": generic},
        seed=settings.seed,
        subjects=[summary.subject for summary in summaries],
        walkers=[summary.subject for summary in summaries[:WALKERS]],
        segment_lengths_mm=documents.compare_lengths(everybody),
        knee_axis_deg=documents.compare_knee_axes(everybody),
        kinematic_error_mm=documents.compare_errors(everybody),
        literature_error_mm=dict(documents.read_paper()["literature_error_mm"]),
        length_difference_mm=documents.compare_length_differences(everybody),
        marker_shift_mm=documents.compare_marker_shifts(everybody),
        notes=CLAIMS.said["notes"],
        statistics=everybody,
        walkers_statistics=walkers,
        slowest_subject_s=round(slowest_s, 3),
        wall_s=round(time.perf_counter() - started, 3),
    )
    return CLAIMS.answer(document)
