"""Virtual persons who wear clusters on thighs and shanks, so that every segment has a pose of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scaling_service.core.streams import stream
from scaling_service.model.body import BodyModel, Marker
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.subject import Session, Subject
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.recording.settings import ProcessingSettings
from scaling_service.virtual.artefact import draw_artefact, draw_residual, with_artefact
from scaling_service.virtual.subject import VirtualSettings, make_virtual_subject, process_recording

CLEAN = VirtualSettings(placement=0.0, artefact=0.0, noise=0.0, gaps=0.0, gait_trials=1)
USUAL = VirtualSettings(placement=0.0, gaps=0.0, gait_trials=1)

PLACES = {
    "femur": [(0.06, -0.18, 0.05), (0.07, -0.28, 0.04), (0.03, -0.20, 0.08), (0.04, -0.30, 0.07)],
    "tibia": [(0.04, -0.15, 0.04), (0.03, -0.25, 0.04), (0.05, -0.20, 0.01), (0.02, -0.28, 0.05)],
}
"""Plates of four markers, in front of and outside the bone, m (right side)."""


@dataclass(frozen=True)
class Clustered:
    """The true model (markers in place at rest) and the recordings."""

    truth: BodyModel
    session: Session


def clusters() -> tuple[Marker, ...]:
    return tuple(
        Marker.at(f"{side.upper()}{bone[0].upper()}C{k}", f"{bone}_{side}", (x, y, z if side == "r" else -z))
        for bone, places in PLACES.items()
        for side in "rl"
        for k, (x, y, z) in enumerate(places)
    )


def clustered(seed: int, settings: VirtualSettings, *, smoothed: bool = True) -> Clustered:
    """The virtual person of that seed, with plates."""
    processing = None if smoothed else ProcessingSettings(smoothing="none")
    who = make_virtual_subject(seed, settings)
    truth = who.model.with_markers((*who.model.markers, *clusters()))
    skin = draw_artefact(seed, truth, who.artefact.reference, settings.artefact)
    moving = with_artefact(truth, skin)
    labels = tuple(m.name for m in truth.markers if m.weight > 0.0)
    trials = {}
    for name, q in who.motions.items():
        times = np.arange(len(q)) / settings.rate_hz
        places = pose_markers(compile_model(moving, labels), q, list_parameter_values(moving))
        places = places + 5e-4 * settings.noise * stream(seed, "plates", name).normal(size=places.shape)
        for k, label in enumerate(labels if name != "static" else ()):
            places[:, k] += draw_residual(skin, stream(seed, "artefact", name, label), times)
        trials[name] = process_recording(
            Trial(name=name, times=times, labels=labels, markers=places, rate_hz=settings.rate_hz),
            truth,
            processing,
        )
    session = Session(
        subject=Subject(
            id=f"virtual_{seed}",
            model=who.generic.name,
            extra_markers={m.name: m.segment for m in clusters()},
        ),
        model=who.generic,
        static=trials["static"],
        calibration=tuple(t for name, t in trials.items() if name.startswith(("hip", "knee"))),
        evaluation=(trials["gait_1"],),
    )
    return Clustered(truth, session)
