"""The person's mass, spread over a scaled model as the generic model spreads its own."""

from __future__ import annotations

from dataclasses import replace

from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import BUILTIN_NAMES, generic_person
from scaling_service.model.results import Calibration
from scaling_service.model.scaling import scaled
from scaling_service.model.subject import Session


def with_mass(calibration: Calibration, session: Session) -> Calibration:
    """The calibration with the person's mass on its model; unchanged where that is not known.

    An OpenSim model is the whole body, so its segments together take the person's mass, as OpenSim's
    scale tool has it (and its set-up's mass, where the subject file gives none). A built-in model may be a
    part of a body: it takes the same share of the person's mass as of its generic person's.
    """
    total = _total_mass(calibration.model, session)
    if total is None:
        return calibration
    return replace(calibration, model=scaled(calibration.model, {}, mass_kg=total))


def _total_mass(model: BodyModel, session: Session) -> float | None:
    subject, own = session.subject, sum(segment.mass for segment in model.segments)
    if own <= 0.0:
        return None
    if subject.mass_kg is None:
        return None if session.scale_setup is None else session.scale_setup.mass_kg
    if subject.model in BUILTIN_NAMES:
        return subject.mass_kg * own / generic_person(subject.model).mass_kg
    return subject.mass_kg
