"""How far bones are found from where they were seen, and whether intervals hold them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np

from scaling_service.capabilities.discovery.bones import learn_bones
from scaling_service.capabilities.discovery.laws.bones import BoneKnowledge
from scaling_service.capabilities.motion.result import TrackedTrial
from scaling_service.capabilities.motion.run import track
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.model.anatomy import skin
from scaling_service.model.body import BodyModel
from scaling_service.model.poses import pose_segments
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array
from tests.living_bone.recordings import SETS, BoneSet, measure_joint_angles, read_bones

JOINTS = {"femur": "hip", "tibia": "knee", "humerus": "shoulder"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """A set with one part of its recordings fitted and the other held out; angles in deg."""

    measured: BoneSet
    exchanged: bool
    before: float
    after: float
    covered: float
    """Of joint angles by the given model, the share that 95 % intervals hold."""
    covered_after: float

    @property
    def ratio(self) -> float:
        """Error after over before."""
        return self.after / self.before


def judge_sets(root: Path, *, leave_out: bool) -> Iterator[Way]:
    """Every sound set, both ways. ``leave_out``: nothing of the set's own laboratory is known of skin."""
    for measured in SETS:
        if measured.sound:
            with leaving_out(measured.laboratory if leave_out else ""):
                yield from _judge(root / measured.name, measured)


def leaving_out(laboratory: str) -> Any:
    """A context in which what a laboratory saw of skin is not known."""
    read = skin.read_measured_skin
    return patch.object(skin, "read_measured_skin", lambda part: read(part).without(laboratory))


def _judge(folder: Path, measured: BoneSet) -> Iterator[Way]:
    session = open_subject(folder / "subject.yaml").session
    parts = (session.calibration, session.evaluation)
    for exchanged, (fit, held_out) in enumerate((parts, parts[::-1])):
        model = learn_from(session.model, fit).add_to(session.model)
        found = [[_measure(m, folder, trial) for trial in held_out] for m in (session.model, model)]
        (before, covered), (after, later) = (np.array(pairs).T for pairs in found)
        yield Way(
            measured=measured,
            exchanged=bool(exchanged),
            before=float(np.sqrt(np.mean(before**2))),
            after=float(np.sqrt(np.mean(after**2))),
            covered=float(covered.mean()),
            covered_after=float(later.mean()),
        )


def learn_from(model: BodyModel, trials: tuple[Trial, ...]) -> BoneKnowledge:
    """What is known of bones from these recordings where nothing was named in them."""
    fit: Any = SimpleNamespace(tracked=[SimpleNamespace(role="fit", trial=trial) for trial in trials])
    return learn_bones(model, fit)


def _measure(model: BodyModel, folder: Path, trial: Trial) -> tuple[float, float]:
    true = read_bones(folder / f"{trial.name}_bones.csv")
    tracked = track(model, trial)
    off, sd = measure_off(tracked, true)
    return measure_bone_error(model, tracked.motion.q, true), float(np.mean(np.abs(off) <= 1.96 * sd))


def measure_off(tracked: TrackedTrial, true: dict[str, Array]) -> tuple[Array, Array]:
    """Joint angles less the true ones, and their standard deviations, rad, all frames in a row."""
    q, sd, names = tracked.motion.q, tracked.uncertainty.sd, tracked.motion.coordinates
    errors, deviations = [], []
    angles = iter(measure_joint_angles(true).T)
    for child in list(true)[1:]:
        for axis in "zxy":
            angle, k = next(angles)[: len(q)], names.index(f"{JOINTS[child]}_{axis}")
            off = (q[: len(angle), k] - angle + np.pi) % (2 * np.pi) - np.pi
            known = np.isfinite(off)
            errors.append(off[known])
            deviations.append(sd[: len(angle), k][known])
    return np.concatenate(errors), np.concatenate(deviations)


def measure_bone_error(model: BodyModel, q: Array, true: dict[str, Array]) -> float:
    """RMS angle between found and true turn of every bone against its parent, deg."""
    poses, names = pose_segments(model, q), list(model.segment_names)
    squares = []
    for parent, child in zip(true, list(true)[1:], strict=False):
        found = [_make_matrices(poses[:, names.index(bone), 3:]) for bone in (parent, child)]
        n = min(len(q), len(true[child]))
        turns = [np.einsum("nji,njk->nik", a[:n], b[:n]) for a, b in (found, (true[parent], true[child]))]
        cosine = (np.einsum("nij,nij->n", *turns) - 1.0) / 2.0
        squares.append(np.arccos(np.clip(cosine, -1.0, 1.0)) ** 2)
    return float(np.degrees(np.sqrt(np.nanmean(squares))))


def _make_matrices(quaternions: Array) -> Array:
    """Rotation matrices (n, 3, 3) of quaternions x y z w."""
    x, y, z, w = quaternions.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(rows), -1, 0)
