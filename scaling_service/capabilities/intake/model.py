"""Which built-in model the markers and plates of a folder call for."""

from __future__ import annotations

from collections.abc import Sequence

from scaling_service.model.anatomy.markers import canonical, strip_prefix
from scaling_service.model.builtin import builtin

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
