"""A virtual person with something hidden in the recordings, for a search that does not know what."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scaling_service.model.body import BodyModel, Law, Term
from scaling_service.model.compile import compile_model, parameter_values
from scaling_service.model.subject import Session, Subject
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import marker_positions
from scaling_service.virtual.subject import GENERIC, VirtualSettings, VirtualSubject, virtual_subject

RECORDED = VirtualSettings(artefact=0.0, functional_s=5.0)
"""Chosen: the skin rests but for what is hidden, so that all there is to find is known; five seconds of each
movement are found to be enough, and are searched in seconds."""

_M_PER_MM, _RAD_PER_DEG = 1e-3, np.pi / 180.0


@dataclass(frozen=True, slots=True)
class Hidden:
    """One thing that was hidden.

    Parameters
    ----------
    kind : str
        As the catalogue of effects calls it.
    where : tuple of str
    parameters : mapping
        With the unit in the name, as results have them.
    driver : tuple of str
    trial : str, optional
        The only recording in which it is.
    """

    kind: str
    where: tuple[str, ...]
    parameters: dict[str, float]
    driver: tuple[str, ...] = ()
    trial: str | None = None


SLIDING = Hidden(
    "soft_tissue_artefact",
    ("RLFE",),
    {"x_mm_per_deg": 0.12, "y_mm_per_deg": 0.16, "z_mm_per_deg": 0.0},
    ("knee_angle_r",),
)
"""A marker of the thigh that slides with the knee: 0.2 mm/deg in all, the usual size of a knee's share
(``THIGH_MM_PER_DEG``)."""

SWAPPED = Hidden("marker_swap", ("LLM", "LMM"), {"start_s": 2.0, "end_s": 2.6}, trial="knee_l")
"""The two markers of an ankle exchanged for 0.6 s, as trackers do after one was hidden (chosen)."""


def hidden_session(
    seed: int, settings: VirtualSettings = RECORDED
) -> tuple[Session, VirtualSubject, tuple[Hidden, ...]]:
    """A person's own model, recordings that hold more than it, and what was hidden.

    The model is the person's: sizes, knee axes and markers are right. Functional movements fit, walking is
    held out; recordings are neither smoothed nor filled.

    Parameters
    ----------
    seed : int
    settings : VirtualSettings

    Returns
    -------
    session : Session
    person : VirtualSubject
    hidden : tuple of Hidden
    """
    person = virtual_subject(seed, settings)
    sliding = _with_sliding(person.model)
    trials = {
        name: trial if name == "static" else _swapped(_slid(trial, person, sliding))
        for name, trial in person.trials.items()
    }
    subject = Subject(
        id=f"virtual_{seed}", model=GENERIC, sex=person.sex, height_m=person.height_m, mass_kg=person.mass_kg
    )
    session = Session(
        subject=subject,
        model=person.model,
        static=trials["static"],
        calibration=tuple(t for name, t in trials.items() if name.startswith(("hip", "knee"))),
        evaluation=tuple(t for name, t in trials.items() if name.startswith("gait")),
    )
    return session, person, (SLIDING, SWAPPED)


def _with_sliding(model: BodyModel) -> BodyModel:
    """The model with the marker that slides."""
    (name,), (driver,) = SLIDING.where, SLIDING.driver
    gains = [_M_PER_MM / _RAD_PER_DEG * SLIDING.parameters[f"{axis}_mm_per_deg"] for axis in "xyz"]
    marker = model.marker(name)
    x, y, z = (
        law + Law((Term(gain, coordinate=driver),)) for law, gain in zip(marker.laws, gains, strict=True)
    )
    moved = replace(marker, laws=(x, y, z))
    return model.with_markers(tuple(moved if m.name == name else m for m in model.markers))


def _slid(trial: Trial, person: VirtualSubject, sliding: BodyModel) -> Trial:
    """The recording with the marker where its skin took it; noise and gaps stay."""
    q, names = person.motions[trial.name], trial.labels
    away = _placed(sliding, names, q) - _placed(person.model, names, q)
    return replace(trial, markers=trial.markers + away)


def _placed(model: BodyModel, names: tuple[str, ...], q: Array) -> Array:
    return marker_positions(compile_model(model, names), q, parameter_values(model))


def _swapped(trial: Trial) -> Trial:
    """The recording with two labels exchanged for a while, where it is the one."""
    if trial.name != SWAPPED.trial:
        return trial
    pair = [trial.index(name) for name in SWAPPED.where]
    start, end = SWAPPED.parameters["start_s"], SWAPPED.parameters["end_s"]
    rows = np.flatnonzero((trial.times >= start - 1e-9) & (trial.times <= end + 1e-9))
    markers = trial.markers.copy()
    markers[rows[:, None], pair] = markers[rows[:, None], pair[::-1]]
    return replace(trial, markers=markers)
