"""Bones against the standing trial: whether landmarks of a bone lie as far apart as the markers over them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from scaling_service.core.errors import SubjectInvalid
from scaling_service.model.anatomy.centres import MARKER_RADIUS_M
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.people import read_people
from scaling_service.model.trial import ImageEvidence, Trial

_SKIN_M, _SKIN_SD_M = (
    5e-3,
    5e-3,
)  # over a bony landmark; chosen: 2 mm in the lean, 15 mm over spines of the heavy
_DOUBTFUL, _IMPOSSIBLE = 3.0, 6.0  # deviations before it is said, and before it is refused; chosen
_IMPOSSIBLE_SHARE = 0.3  # chosen: beside them, as of lengths between joints: what no marker is misplaced by
_REMEDY = "check that bones and recordings are of one person, the labels, and the unit of the bones"


@dataclass(frozen=True, slots=True)
class _Span:
    """Two landmarks of one bone; ``outwards``: how many markers stand outwards along their line."""

    words: str
    ends: tuple[str, str]
    bone: str
    outwards: int = 0


_SPANS = (
    _Span("between the front spines", ("RASIS", "LASIS"), "pelvis"),
    _Span("between the rear spines", ("RPSIS", "LPSIS"), "pelvis"),
    _Span("from the right front to the right rear spine", ("RASIS", "RPSIS"), "pelvis", 2),
    _Span("from the left front to the left rear spine", ("LASIS", "LPSIS"), "pelvis", 2),
    *tuple(
        _Span(
            f"{words} of the {side} leg",
            (f"{letter}{first}", f"{letter}{second}"),
            f"{bone}_{letter.lower()}",
            n,
        )
        for letter, side in (("R", "right"), ("L", "left"))
        for words, first, second, bone, n in (
            ("between the epicondyles", "LFE", "MFE", "femur", 2),
            ("between the malleoli", "LM", "MM", "tibia", 2),
            ("from the fibula's head to its malleolus", "FH", "LM", "tibia", 0),
        )
    ),
)


def doubt_landmarks(evidence: ImageEvidence, standing: Trial | None) -> list[str]:
    """A warning for each distance on a bone that its markers do not have, as far as they can be misplaced.

    Palpation (``people.yaml``), skin, and what the image leaves open of each landmark make the deviation.
    Raises SubjectInvalid: six deviations and 30 % apart, so that bones and recordings are not of one person.
    """
    return [] if standing is None else list(_compare(evidence, standing))


def _compare(evidence: ImageEvidence, standing: Trial) -> Iterator[str]:
    people = read_people()
    shown = {find_canonical(label) or label: label for label in standing.shown_labels}
    for span in _SPANS:
        if not set(span.ends) <= evidence.landmarks.keys() & shown.keys():
            continue
        apart = [standing.position(shown[end]) for end in span.ends]
        marked = float(np.nanmedian(np.linalg.norm(apart[0] - apart[1], axis=1)))
        seen = [np.array(evidence.landmarks[end]) for end in span.ends]
        bone = float(np.linalg.norm(seen[0] - seen[1]))
        expected = bone + span.outwards * (MARKER_RADIUS_M + _SKIN_M)
        variance = span.outwards * _SKIN_SD_M**2
        for end in span.ends:
            palpated = np.array(people.place_sd(end[1:]))
            variance += float(np.mean(palpated**2)) + evidence.deviations.get(end, 0.0) ** 2 / 3.0
        sd = float(np.sqrt(variance))
        off = abs(marked - expected)
        if off <= _DOUBTFUL * sd:
            continue
        said = (
            f"{span.words} are {1e3 * bone:.0f} mm by the bones, where markers would stand "
            f"{1e3 * expected:.0f} ± {1e3 * sd:.0f} mm apart, and {1e3 * marked:.0f} mm by the standing trial"
        )
        if off > _IMPOSSIBLE * sd and off > _IMPOSSIBLE_SHARE * expected:
            raise SubjectInvalid(said, field=f"bones.{span.bone}", remedy=_REMEDY[0].upper() + _REMEDY[1:])
        yield f"EB: {said}: {_REMEDY}"
