"""What a gait laboratory reads from one model's motions: angles, cycles, profile and score."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass

from scaling_service.capabilities.scaling.clinical.angles import (
    SIDES,
    ClinicalAngles,
    ClinicalCycles,
    clinical_angles,
    clinical_cycles,
)
from scaling_service.capabilities.scaling.clinical.gait_profile import (
    GaitProfile,
    Reference,
    gait_profile,
    schwartz2008,
)
from scaling_service.capabilities.scaling.comparison.gait_cycles import find_gait_cycles
from scaling_service.model.anatomy.frames import Side
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Motion
from scaling_service.model.trial import Trial


@dataclass(frozen=True, slots=True, eq=False)
class ClinicalGait:
    """The conventional angles of one model of one person.

    Parameters
    ----------
    recordings : mapping
        Trial to its angles, of every trial that the model follows.
    cycles : mapping
        Side to its gait cycles; sides without one are absent.
    profile : GaitProfile
        Over these cycles.
    reference : Reference
        What the profile is compared with.
    held_out : bool
        Whether the cycles are from trials that were not fitted.
    left_out : tuple of str
        Which angles are not there and why.
    doubtful : tuple of str
        Which are there but rest on little.
    reason : str
        Why there is no cycle, one sentence without a full stop; empty where there is one.
    """

    recordings: Mapping[str, ClinicalAngles]
    cycles: Mapping[Side, ClinicalCycles]
    profile: GaitProfile
    reference: Reference
    held_out: bool
    left_out: tuple[str, ...]
    doubtful: tuple[str, ...]
    reason: str = ""


def clinical_gait(
    model: BodyModel, motions: Mapping[str, Motion], trials: Sequence[Trial], fitted: Container[str] = ()
) -> ClinicalGait:
    """The conventional angles of a model over its motions, and over the gait cycles that the markers show.

    Parameters
    ----------
    model : BodyModel
    motions : mapping
        Trial to motion; trials without one are passed over.
    trials : sequence of Trial
        Processed: gait cycles are found in their markers.
    fitted : container of str
        Trials that the model was fitted to: their cycles count only where no other trial shows one.
    """
    followed = [trial for trial in trials if trial.name in motions]
    recordings = {trial.name: clinical_angles(model, motions[trial.name]) for trial in followed}
    held_out = [trial for trial in followed if trial.name not in fitted]
    cycles = _cycles(recordings, held_out)
    of_held_out = bool(cycles)
    if not cycles:
        cycles = _cycles(recordings, [trial for trial in followed if trial.name in fitted])
    reference = schwartz2008()
    profile = gait_profile({side: found.values for side, found in cycles.items()}, reference)
    left_out = dict.fromkeys(said for angles in recordings.values() for said in angles.left_out)
    doubtful = dict.fromkeys(said for angles in recordings.values() for said in angles.doubtful)
    return ClinicalGait(
        recordings,
        cycles,
        profile,
        reference,
        of_held_out,
        tuple(left_out),
        tuple(doubtful),
        "" if cycles else _reason(followed),
    )


def _cycles(recordings: Mapping[str, ClinicalAngles], trials: Sequence[Trial]) -> dict[Side, ClinicalCycles]:
    found = {
        side: clinical_cycles(
            [(recordings[trial.name], find_gait_cycles(trial, side).cycles) for trial in trials], side
        )
        for side in SIDES
    }
    return {side: cycles for side, cycles in found.items() if cycles is not None}


def _reason(trials: Sequence[Trial]) -> str:
    reasons = [find_gait_cycles(trial, side).reason for trial in trials for side in SIDES]
    said = [reason for reason in reasons if reason]
    return (said or ["no whole stride is followed" if trials else "no movement was recorded"])[0]
