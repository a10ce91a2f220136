"""Simulation-based calibration: errors and intervals of each method on persons whose bodies are known.

The persons are drawn and moved by :mod:`.persons`, which shares nothing with the product.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.motion.run import track
from scaling_service.capabilities.scaling.methods.table import calibrate
from scaling_service.capabilities.scaling.run import run
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.model.builtin import load_builtin
from scaling_service.model.results import Calibration
from scaling_service.model.subject import Session, Subject
from scaling_service.model.trial import Trial
from scaling_service.studies.benchmark.persons import RATE_HZ, Person, World, draw_person

SEGMENTS = {
    "femur_r": "femur_r",
    "femur_l": "femur_l",
    "shank_r": "tibia_r",
    "shank_l": "tibia_l",
    "inter_hip": "pelvis",
}
"""Length to the segment whose size it is."""

ORDINARY = World()

QUANTILES = {50: 0.6745, 80: 1.2816, 95: 1.9600}
"""Per cent of a Gaussian within so many standard deviations."""


@dataclass(frozen=True)
class Errors:
    """Of one quantity over all persons: errors and stated deviations (nan: not stated), mm or deg."""

    error: np.ndarray
    sd: np.ndarray

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(np.square(self.error))))

    @property
    def stated(self) -> float:
        return float(np.sqrt(np.mean(np.square(self.sd))))

    def cover(self, per_cent: int) -> float:
        """Share of errors within the interval that should hold so many per cent."""
        return float(np.mean(np.abs(self.error) <= QUANTILES[per_cent] * self.sd))


def record(person: Person) -> Session:
    """The recordings as a laboratory has them, on a generic model."""
    model = load_builtin("lower_limb_14dof")
    trials = {
        name: Trial(
            name=name, times=t, labels=tuple(at), markers=np.stack(list(at.values()), axis=1), rate_hz=RATE_HZ
        )
        for name, (t, at) in person.trials.items()
    }
    clusters = {n: s for n, s in person.segments.items() if n not in model.marker_names}
    subject = Subject("V", model.name, sex=person.sex, height_m=person.height, extra_markers=clusters)
    return Session(
        subject=subject,
        model=model,
        static=trials["static"],
        calibration=(trials["functional_r"], trials["functional_l"]),
        evaluation=(trials["walk"],),
    )


def measure(
    seeds: Iterable[int], methods: Sequence[str], world: World = ORDINARY
) -> dict[str, dict[str, Errors]]:
    """Method to quantity, both sides alike, to errors: lengths, and angles of a walk that was not fitted."""
    found: dict[tuple[str, str], list[tuple[np.ndarray, np.ndarray]]] = {}
    for seed in seeds:
        person = draw_person(seed, world)
        session = record(person)
        for method, scaled in _scale(session, methods).items():
            for name, error, sd in (*_lengths(scaled, person), *_angles(scaled, session, person)):
                found.setdefault((method, name), []).append((error, sd))
    return {
        method: {
            name: Errors(*(np.concatenate(column) for column in zip(*parts, strict=True)))
            for (own, name), parts in found.items()
            if own == method
        }
        for method in methods
    }


def _scale(session: Session, methods: Sequence[str]) -> dict[str, Calibration]:
    """As ``compare`` does it: what methods beside MAP state, they have from it. MAP alone needs no other."""
    if list(methods) == ["MAP"]:
        return {"MAP": calibrate(session, "MAP")}
    results = run(Loaded(session=session), methods)
    return {method: scaling.calibration for method, scaling in results.scalings.items()}


def _lengths(scaled: Calibration, person: Person):
    for name, length in measure_segment_lengths(scaled.model).items():
        size = scaled.sizes.get(SEGMENTS[name])
        sd = np.nan if size is None else size.sd * length
        yield _without_side(name), 1e3 * np.array([length - person.lengths[name]]), 1e3 * np.array([sd])


def _angles(scaled: Calibration, session: Session, person: Person):
    tracked = track(scaled.model, session.evaluation[0])
    for name, true in person.angles["walk"].items():
        column = tracked.motion.coordinates.index(name)
        off = tracked.motion.q[:, column] - true
        yield _without_side(name), np.degrees(off), np.degrees(tracked.uncertainty.sd[:, column])
        mean = tracked.uncertainty.mean
        sd = np.nan if mean is None else mean[column]
        yield f"{_without_side(name)} mean", np.degrees([off.mean()]), np.degrees([sd])


def _without_side(name: str) -> str:
    return name[:-2] if name[-2:] in ("_r", "_l") else name
