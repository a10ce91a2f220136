"""Bones against people and the standing trial: hips below their spines, landmarks as far apart as markers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scaling_service.core.errors import SubjectInvalid
from scaling_service.core.names import say_name
from scaling_service.model import people as population
from scaling_service.model import trial
from scaling_service.model.anatomy.frames import build_pelvis_frame
from scaling_service.model.anatomy.hip_centre import predict_hip_centres
from scaling_service.model.anatomy.markers import find_canonical

_DOUBTFUL, _IMPOSSIBLE = 3.0, 6.0  # deviations before it is said, and before it is refused; chosen
_IMPOSSIBLE_SHARE = 0.3  # chosen: beside them, as of lengths between joints: what no marker is misplaced by
_HIP_REMEDY = (
    "look at the landmarks of the pelvis (`scaling-service landmarks`); give it whole, without the sacrum"
)
_REMEDY = "check that bones and recordings are of one person, the labels, and the unit of the bones"

_PELVIS = (
    ("between the front spines", ("RASIS", "LASIS"), "pelvis", False),
    ("between the rear spines", ("RPSIS", "LPSIS"), "pelvis", False),
    ("from right front to rear spine", ("RASIS", "RPSIS"), "pelvis", True),
    ("from left front to rear spine", ("LASIS", "LPSIS"), "pelvis", True),
)
"""Two landmarks of one bone, and whether skin lies outwards of both, along their line."""

_LEG = (
    ("between the epicondyles", "LFE", "MFE", "femur", True),
    ("between the malleoli", "LM", "MM", "tibia", True),
    ("from the fibula's head to its malleolus", "FH", "LM", "tibia", False),
)
_SPANS = _PELVIS + tuple(
    (
        f"{words} of the {side} leg",
        (f"{side[0].upper()}{first}", f"{side[0].upper()}{second}"),
        f"{bone}_{side[0]}",
        outwards,
    )
    for side in ("right", "left")
    for words, first, second, bone, outwards in _LEG
)


def doubt_landmarks(evidence: trial.ImageEvidence, standing: trial.Trial | None) -> list[str]:
    """A warning for hips where no person's are, and for each distance in the image that markers do not have.

    Hips: below the pelvis's own spines as a regression has them. Distances: between the image's own markers
    where it shows them, else between landmarks: over spines with skin as people have it, over knees and
    ankles with any, so that only markers nearer than the bone are told. Palpation and what the image leaves
    open make the deviation (``people.yaml``). Raises SubjectInvalid: hips six deviations off, or a distance
    six and 30 %, so that landmarks are wrong or bones and recordings not of one person.
    """
    return [*_compare_hips(evidence), *([] if standing is None else _compare(evidence, standing))]


def _compare_hips(evidence: trial.ImageEvidence) -> Iterator[str]:
    """A warning for a hip that lies where no person's does in a pelvis of such spines."""
    if not {"RASIS", "LASIS", "RPSIS", "LPSIS"} <= evidence.landmarks.keys():
        return
    people = population.read_people()
    spines = [np.array(evidence.landmarks[name]) for name in ("RASIS", "LASIS", "RPSIS", "LPSIS")]
    usual = predict_hip_centres(*spines, regression="harrington2007_single")  # by the width alone
    frame = build_pelvis_frame(*spines)
    for side, expected in (("r", usual.right[0]), ("l", usual.left[0])):
        if f"hip_{side}" not in evidence.centres:
            continue
        off = frame.to_local(np.array(evidence.centres[f"hip_{side}"]))[0] - expected
        open_ = [evidence.deviations.get(name, 0.0) ** 2 / 3.0 for name in ("RASIS", "LASIS", f"hip_{side}")]
        deviations = float(
            np.linalg.norm(off / np.sqrt(np.square(people.hip_sd) + sum(open_))) / np.sqrt(3.0)
        )
        if deviations <= _DOUBTFUL:
            continue
        said = (
            f"{say_name(f'hip_{side}')} lies {1e3 * float(np.linalg.norm(off)):.0f} mm from where people's "
            "hips lie in a pelvis of such spines"
        )
        if deviations > _IMPOSSIBLE:
            raise SubjectInvalid(said, field="bones.pelvis", remedy=_HIP_REMEDY[0].upper() + _HIP_REMEDY[1:])
        yield f"EB: {said}: {_HIP_REMEDY}"


def _expect(
    evidence: trial.ImageEvidence, ends: tuple[str, str], bone: str, outwards: bool, people: population.People
) -> tuple[float, float, bool] | None:
    """Distance of markers by the image, its deviation, m, and whether skin may widen it; None if unseen."""
    imaged = {find_canonical(name) or name: at for name, (_, at) in evidence.markers.items()}
    skin = not set(ends) <= imaged.keys()
    places = evidence.landmarks if skin else imaged
    if not set(ends) <= places.keys():
        return None
    first, second = (np.array(places[end]) for end in ends)
    apart = float(np.linalg.norm(first - second))
    variance = 0.0
    for end in ends:
        variance += float(np.mean(np.square(people.place_sd(end[1:]))))
        variance += evidence.deviations.get(end, 0.0) ** 2 / 3.0 if skin else people.image_marker**2
    if skin and outwards and bone == "pelvis":
        for mean, sd in (people.skin_over_asis, people.skin_over_psis):
            apart, variance = apart + mean, variance + sd**2
    return apart, float(np.sqrt(variance)), skin and outwards and bone != "pelvis"


def _compare(evidence: trial.ImageEvidence, standing: trial.Trial) -> Iterator[str]:
    people = population.read_people()
    shown = {find_canonical(label) or label: label for label in standing.shown_labels}
    for words, between, bone, outwards in _SPANS:
        found = _expect(evidence, between, bone, outwards, people)
        if found is None or not set(between) <= shown.keys():
            continue
        expected, sd, widened = found
        ends = [standing.position(shown[end]) for end in between]
        marked = float(np.nanmedian(np.linalg.norm(ends[0] - ends[1], axis=1)))
        if widened and marked > expected:
            continue
        off = abs(marked - expected)
        if off <= _DOUBTFUL * sd:
            continue
        said = (
            f"{words} markers would stand {1e3 * expected:.0f} ± {1e3 * sd:.0f} mm apart by the image, "
            f"and are {1e3 * marked:.0f} mm apart in the standing trial"
        )
        if off > _IMPOSSIBLE * sd and off > _IMPOSSIBLE_SHARE * expected:
            raise SubjectInvalid(said, field=f"bones.{bone}", remedy=_REMEDY[0].upper() + _REMEDY[1:])
        yield f"EB: {said}: {_REMEDY}"
