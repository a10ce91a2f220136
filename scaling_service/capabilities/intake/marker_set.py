"""The marker set of a folder's recordings: what it means for each method, and which model it calls for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from scaling_service.capabilities.intake.document import MarkerSetProof, SizesProof
from scaling_service.model.anatomy.marker_sets import plane_marker, recognise
from scaling_service.model.anatomy.markers import canonical, strip_prefix
from scaling_service.model.builtin import builtin

_JOINTS = (("knee", "LFE", "MFE", "knee_width", "thigh"), ("ankle", "LM", "MM", "ankle_width", "shank"))
"""Joint, its outer and inner landmark, the width between them, and what carries the marker of its plane."""


def marker_set_proof(labels: Sequence[str]) -> MarkerSetProof | None:
    """The set that all labels together are closest to."""
    found = recognise(labels)
    if found is None:
        return None
    return MarkerSetProof(
        name=found.name,
        title=found.title,
        share=round(found.share, 3),
        lacks=list(found.lacks),
        additions=list(found.additions),
    )


def consequences(labels: Sequence[str], sizes: SizesProof) -> Iterator[str]:
    """What landmarks that are missing mean for scaling.

    ``labels``: of all recordings.
    """
    there = {canonical(label) for label in labels}
    if "SACR" in there and not {"RPSIS", "LPSIS"} <= there:
        yield (
            "SACR instead of two PSIS markers: it stands for the point half-way between them; "
            "the pelvis' depth and the hip centres rest on it"
        )
    unsure = []
    for joint, outer, inner, width, segment in _JOINTS:
        sides = [s for s in "RL" if f"{s}{outer}" in there and f"{s}{inner}" not in there]
        if not sides:
            continue
        unsure += [joint] if joint == "knee" else []
        yield _of_one_side(joint, width, segment, sides, labels, sizes)
    if unsure:
        yield (
            "MB_lam and MB_am: without an inner knee marker hip rotation and the knee's axis are hardly "
            "determined; a movement that bends the knees, or a static trial with inner markers, tells more"
        )
        yield "EB and EB_am take the knee's centre and axis from the bones, where there are any"


def _of_one_side(
    joint: str, width: str, segment: str, sides: Sequence[str], labels: Sequence[str], sizes: SizesProof
) -> str:
    known = [f"{width}_{side.lower()}" for side in sides]
    measured = [f"{sizes.sizes_mm[name]:g}" for name in known if name in sizes.sizes_mm]
    planes = [
        plane_marker(labels, "knee" if joint == "knee" else "ankle", "r" if s == "R" else "l") for s in sides
    ]
    text = f"no inner {joint} marker: MB takes the joint's centre from the outer one and half its width"
    text += f" ({' and '.join(measured)} mm)" if len(measured) == len(known) else ""
    if all(planes):
        text += f", in the plane of the {segment}'s marker ({', '.join(p for p in planes if p)})"
    if len(measured) < len(known):
        missing = ", ".join(f"{name}_mm: …" for name in known if name not in sizes.sizes_mm)
        text += f"; the width is not known: measure it and give `sizes: {{{missing}}}`"
    return text


LEGS, FEET, WHOLE = "lower_limb_14dof", "lower_limb_feet_18dof", "full_body_35dof"

LARGELY = 0.9
"""Chosen: share of the whole body's markers that must be there; arms and trunk with fewer cost more than they
tell, and the legs are the safe choice."""

_FOREFOOT = ("TOE", "MT1", "MT5")


def choose_model(movements: Sequence[Sequence[str]], forces: bool) -> tuple[str, str]:
    """A built-in model and why.

    ``movements``: labels that are seen in each movement; those of standing where there is none. ``forces``:
    whether there are ground forces.
    """
    known = [{canonical(label) or strip_prefix(label).upper() for label in labels} for labels in movements]
    common = set.intersection(*known) if known else set()
    whole = [m.name for m in builtin(WHOLE).markers if m.weight > 0.0]
    share = sum(name in common for name in whole) / len(whole)
    if share >= LARGELY:
        return WHOLE, f"{share:.0%} of its markers are in every movement"
    footed = all(
        f"{side}HEE" in common and any(f"{side}{name}" in common for name in _FOREFOOT) for side in "RL"
    )
    if footed and forces:
        return (
            FEET,
            f"heels and toes have markers and there are force plates; trunk and arms: {share:.0%} of {WHOLE}",
        )
    return LEGS, "the legs, the safe choice"
