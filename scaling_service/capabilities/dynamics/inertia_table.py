"""Which inertia a model takes into its dynamics: its own, or that of a table."""

from __future__ import annotations

from dataclasses import dataclass

from scaling_service.capabilities.dynamics.settings import DEFAULT_TABLE
from scaling_service.capabilities.shared.names import OWN as OWN
from scaling_service.capabilities.shared.names import check_inertia as check_inertia
from scaling_service.core.errors import SubjectInvalid
from scaling_service.model.anatomy.inertia import apply_inertia_table
from scaling_service.model.anatomy.inertia_planar import SQUAT, apply_to_squat
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import BUILTIN_NAMES
from scaling_service.model.subject import Subject


@dataclass(frozen=True, slots=True, eq=False)
class Massive:
    """A model with the inertia that was chosen.

    ``inertia`` is a table's name or ``OWN``; ``notes`` say what had to be decided.
    """

    model: BodyModel
    inertia: str
    notes: tuple[str, ...] = ()


def with_inertia(model: BodyModel, subject: Subject, inertia: str | None, *, scaled: bool) -> Massive:
    """The model with the inertia that was asked for.

    Parameters
    ----------
    model : BodyModel
        Of the person's size.
    subject : Subject
    inertia : str, optional
        A table's name or ``OWN``. Unless given: ``DEFAULT_TABLE`` for a built-in model that was scaled, else
        the model's own.
    scaled : bool
        Whether the model was scaled to the person.

    Raises
    ------
    SubjectInvalid
        There is no such table, or the table needs what the subject file does not say.
    InputError
        The table cannot be applied to this model or person.
    """
    check_inertia(inertia)
    chosen = inertia or (DEFAULT_TABLE if scaled and subject.model in BUILTIN_NAMES else OWN)
    if chosen == OWN:
        return Massive(model, OWN)
    if subject.sex is None or subject.height_m is None or subject.mass_kg is None:
        lacking = next(n for n in ("sex", "height_m", "mass_kg") if getattr(subject, n) is None)
        raise SubjectInvalid(
            f"inertial tables need the person's {lacking.split('_')[0]}",
            field=f"subject.{lacking}",
            remedy=f"Give it, or keep the model's own inertia (inertia: {OWN})",
        )
    apply = apply_to_squat if subject.model == SQUAT else apply_inertia_table
    result = apply(model, chosen, sex=subject.sex, height_m=subject.height_m, mass_kg=subject.mass_kg)
    return Massive(result.model, chosen, result.notes)
