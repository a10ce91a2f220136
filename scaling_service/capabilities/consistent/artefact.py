"""How far soft tissue lets markers stray: the weights of table 1 of Futamure et al."""

from __future__ import annotations

from collections.abc import Mapping

from scaling_service.model.anatomy.markers import canonical
from scaling_service.model.body import GROUND, BodyModel, Joint

ARTEFACT_M: Mapping[str, float] = {
    "toe": 0.001,
    "ankle": 0.010,
    "shank": 0.015,
    "knee": 0.030,
    "pelvis": 0.017,
    "T10": 0.0107,
    "sternum": 0.015,
    "acromion": 0.010,
}
"""Futamure et al., table 1, m."""

_OF_MARKERS: Mapping[str, str] = {
    "TOE": "toe",
    "ANK": "ankle",
    "RLM": "ankle",
    "RMM": "ankle",
    "KNE": "knee",
    "RLFE": "knee",
    "RMFE": "knee",
    "C7": "T10",
    "T10": "T10",
    "CLAV": "sternum",
    "STRN": "sternum",
    "RSC": "sternum",
    "SHO": "acromion",
    "RSHO": "acromion",
}
"""Rows for markers by name. C7 and CLAV are not in the table: chosen as the nearest site."""

_OF_SEGMENTS: tuple[tuple[str, str], ...] = (
    ("pelvis", "pelvis"),
    ("femur", "knee"),
    ("thigh", "knee"),
    ("tibia", "shank"),
    ("shank", "shank"),
    ("talus", "ankle"),
    ("calcn", "ankle"),
    ("foot", "ankle"),
    ("toes", "ankle"),
    ("head", "acromion"),
    ("humerus", "acromion"),
    ("ulna", "acromion"),
    ("radius", "acromion"),
    ("hand", "acromion"),
    ("arm", "acromion"),
)
"""Rows for all other markers, by how their segment's name begins. Chosen: thighs as the knee, the largest;
feet
as the ankle (the table's toe is that of a foot that cannot move), head and arms as the acromion."""

_ELSE = "sternum"
"""Any other segment is a part of the trunk."""


def artefact_m(model: BodyModel) -> dict[str, float]:
    """The expected error of every marker of a model, m."""
    still = {s.name for s in model.segments if s.parent == GROUND and not any(map(_moves, s.joints))}
    found = {}
    for marker in model.markers:
        row = _OF_MARKERS.get(_right(marker.name))
        if row is None or (row == "toe" and marker.segment not in still):
            row = next((r for start, r in _OF_SEGMENTS if marker.segment.startswith(start)), _ELSE)
        found[marker.name] = ARTEFACT_M[row]
    return found


def _right(name: str) -> str:
    """The landmark's name on the right-hand side."""
    known = canonical(name) or name
    mirrored = f"R{known[1:]}"
    return mirrored if known.startswith("L") and mirrored in _OF_MARKERS else known


def _moves(joint: Joint) -> bool:
    return any(term.coordinate is not None for term in joint.law.terms)
