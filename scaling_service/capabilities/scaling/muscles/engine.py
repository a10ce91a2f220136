"""Muscles of an exported model beside OpenSim's, over every coordinate's range."""

from __future__ import annotations

import csv
from collections import abc
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import DependencyMissing
from scaling_service.documents import engines
from scaling_service.files import mujoco_muscles
from scaling_service.files.limbs import Skeleton
from scaling_service.files.osim.muscles import MuscleGeometry, measure_muscles
from scaling_service.model.body import BodyModel
from scaling_service.model.muscles import Musculature
from scaling_service.model.poses import sweep_coordinates

STEPS = 25  # of each range; chosen: 5 degrees of a range of 120
LENGTH_M, WRAPPING_LENGTH_M, ARM_M = 1e-3, 3e-3, 2e-3
"""What is asked of differences. Chosen: below what attachments are known to, some millimetres."""

UNKNOWN = "no cause is known"
_NEAR = 2e-3  # rad; chosen: a tenth of a degree to each side
_NO_ARM = 1e-6  # m; chosen: moment arms below are none
_TOLD = 5  # of the worst, in words
_JUMP_M = 1e-3  # chosen: beyond it OpenSim's lengths and moment arms contradict each other


@dataclass(frozen=True, slots=True, eq=False)
class MuscleCheck:
    """An exported model's muscles and OpenSim's."""

    document: engines.EngineMuscleDocument
    sweeps: abc.Mapping[str, Array]  # coordinate to its values, (n_steps,), rad
    engine: mujoco_muscles.EngineMuscles
    reference: MuscleGeometry | None  # over all sweeps one after the other


def check_muscles(model: BodyModel, osim: str, muscles: Musculature, exported: Skeleton) -> MuscleCheck:
    """Hold an MJCF file's muscles against OpenSim's, which are computed by OpenSim itself.

    ``model``: what both files hold, without parameters. ``osim``, ``exported``: their texts.
    ``muscles``: those of the ``.osim`` file.
    Raises DependencyMissing: MuJoCo is not installed. Without OpenSim nothing is compared, and the document
    says so.
    """
    poses = sweep_coordinates(model, STEPS)
    engine = mujoco_muscles.measure_in_mujoco(exported.text, model.coordinate_names, poses)
    values = {name: q[:, model.coordinate_names.index(name)] for name, q in poses.items()}
    try:
        reference = measure_muscles(osim, model, np.concatenate(list(poses.values())))
    except DependencyMissing as error:
        return MuscleCheck(_make_document(engine, [], exported, None, str(error)), values, engine, None)
    wraps = {m.name: any(pose[k] for pose in muscles.contacts) for k, m in enumerate(muscles.muscles)}
    order = [engine.muscles.index(name) for name in reference.muscles]
    lengths = {n: reference.lengths[k * STEPS : (k + 1) * STEPS] for k, n in enumerate(poses)}
    arms = {n: _gather_arms(reference, n, slice(k * STEPS, (k + 1) * STEPS)) for k, n in enumerate(poses)}
    off_lengths = {n: engine.lengths[n][:, order] - lengths[n] for n in poses}
    off_arms = {n: engine.arms[n][:, order] - arms[n] for n in poses}
    rows = []
    for k, name in enumerate(reference.muscles):
        length, arm = _find_worst(off_lengths, values, k), _find_worst(off_arms, values, k)
        asked = WRAPPING_LENGTH_M if wraps[name] else LENGTH_M
        within = length[0] <= asked and arm[0] <= ARM_M
        own = [] if within else _find_contradiction(k, values, lengths, arms, off_lengths)
        causes = [] if within else [*own, *exported.changed.get(name, ())]
        rows.append(
            engines.EngineMuscle(
                muscle=name,
                wraps=wraps[name],
                length_mm=round(1e3 * length[0], 3),
                length_at=length[1],
                length_at_deg=round(float(np.degrees(length[2])), 2),
                moment_arm_mm=round(1e3 * arm[0], 3),
                moment_arm_at=arm[1],
                moment_arm_at_deg=round(float(np.degrees(arm[2])), 2),
                within=within,
                causes=causes or ([] if within else [UNKNOWN]),
            )
        )
    rows = _explain_arms(rows, model, osim, off_arms, values)
    reached = f"OpenSim {version('opensim')}"
    return MuscleCheck(_make_document(engine, rows, exported, reached, ""), values, engine, reference)


def _gather_arms(reference: MuscleGeometry, coordinate: str, rows: slice) -> Array:
    """Moment arms of all muscles about a coordinate in some frames, (n_frames, n_muscles), m."""
    nothing = np.zeros(len(reference.lengths))
    return np.column_stack(
        [reference.arms.get((name, coordinate), nothing)[rows] for name in reference.muscles]
    )


def _find_worst(
    off: abc.Mapping[str, Array], values: abc.Mapping[str, Array], muscle: int
) -> tuple[float, str, float]:
    """The largest difference of a muscle, the coordinate that was moved there, and its value."""
    worst = {name: int(np.argmax(np.abs(each[:, muscle]))) for name, each in off.items()}
    name = max(worst, key=lambda n: abs(off[n][worst[n], muscle]))
    return abs(float(off[name][worst[name], muscle])), name, float(values[name][worst[name]])


def _find_contradiction(
    number: int,
    values: abc.Mapping[str, Array],
    lengths: abc.Mapping[str, Array],
    arms: abc.Mapping[str, Array],
    off: abc.Mapping[str, Array],
) -> list[str]:
    """Whether the difference grows where OpenSim's length is not the integral of OpenSim's moment arm."""
    gaps: dict[str, float] = {}
    for name, x in values.items():
        arm, length = arms[name][:, number], lengths[name][:, number]
        steps = -0.5 * (arm[1:] + arm[:-1]) * np.diff(x)
        gap = float(np.abs(length - length[0] - np.concatenate([[0.0], np.cumsum(steps)])).max())
        if min(gap, float(np.ptp(off[name][:, number]))) > _JUMP_M:
            gaps[name] = gap
    if not gaps:
        return []
    worst = max(gaps, key=lambda name: gaps[name])
    return [
        f"OpenSim's own length is up to {1e3 * gaps[worst]:.1f} mm from the integral of its moment arm about"
        f" {worst}"
    ]


def _explain_arms(
    rows: list[engines.EngineMuscle],
    model: BodyModel,
    osim: str,
    off: abc.Mapping[str, Array],
    values: abc.Mapping[str, Array],
) -> list[engines.EngineMuscle]:
    """Rows whose moment arm is off, with the slope of OpenSim's own length where it is off most.

    ``off``: coordinate to the engine's moment arms less OpenSim's, (n_steps, n_rows), m.
    """
    far = [k for k, row in enumerate(rows) if row.moment_arm_mm > 1e3 * ARM_M]
    if not far:
        return rows
    default = np.array([c.default for c in model.coordinates])
    q = np.tile(default, (3 * len(far), 1))
    for n, k in enumerate(far):
        name = rows[k].moment_arm_at
        at = values[name][np.argmax(np.abs(off[name][:, k]))]
        q[3 * n : 3 * n + 3, model.coordinate_names.index(name)] = at + np.array([-_NEAR, 0.0, _NEAR])
    near, explained = measure_muscles(osim, model, q), list(rows)
    for n, k in enumerate(far):
        row, lengths = rows[k], near.lengths[3 * n : 3 * n + 3, k]
        arm = float(near.arms.get((row.muscle, row.moment_arm_at), np.zeros(len(q)))[3 * n + 1])
        theirs = arm + off[row.moment_arm_at][np.argmax(np.abs(off[row.moment_arm_at][:, k])), k]
        slopes = -np.diff(lengths) / _NEAR  # on both sides: at a kink one of them is far off
        slope = float(slopes[np.argmin(np.abs(slopes - theirs))])
        if abs(slope - theirs) < abs(slope - arm):
            said = (
                f"OpenSim's own length changes there as for a moment arm of {1e3 * slope:.1f} mm, its moment"
                f" arm is {1e3 * arm:.1f} mm, the engine's {1e3 * theirs:.1f} mm"
            )
            causes = [said, *(cause for cause in row.causes if cause != UNKNOWN)]
            explained[k] = row.model_copy(update={"causes": causes})
    return explained


def _make_document(
    engine: mujoco_muscles.EngineMuscles,
    rows: list[engines.EngineMuscle],
    exported: Skeleton,
    reference: str | None,
    note: str,
) -> engines.EngineMuscleDocument:
    def share(within: list[bool]) -> float | None:
        return round(float(np.mean(within)), 4) if within else None

    asked = {row.muscle: 1e3 * (WRAPPING_LENGTH_M if row.wraps else LENGTH_M) for row in rows}
    ranked = sorted(
        rows,
        key=lambda r: -max(r.length_mm / asked[r.muscle], r.moment_arm_mm / (1e3 * ARM_M)),
    )
    return engines.EngineMuscleDocument(
        engine=engine.engine,
        reference=reference,
        coordinates=list(engine.lengths),
        steps=STEPS,
        asked_length_mm=1e3 * LENGTH_M,
        asked_wrapping_length_mm=1e3 * WRAPPING_LENGTH_M,
        asked_moment_arm_mm=1e3 * ARM_M,
        share_lengths_within=share([row.length_mm <= asked[row.muscle] for row in rows]),
        share_moment_arms_within=share([row.moment_arm_mm <= 1e3 * ARM_M for row in rows]),
        share_within=share([row.within for row in rows]),
        muscles=ranked,
        summary=[_summarise(ranked, engine.engine, reference), *_name_worst(ranked)] if rows else [note],
        changed=[each for said in exported.changed.values() for each in said],
    )


def _summarise(rows: list[engines.EngineMuscle], engine: str, reference: str | None) -> str:
    within = sum(row.within for row in rows)
    return (
        f"Over every coordinate's range {within} of {len(rows)} muscles are in {engine} as in {reference}:"
        f" lengths within {1e3 * LENGTH_M:g} mm ({1e3 * WRAPPING_LENGTH_M:g} mm where they wrap), moment arms"
        f" within {1e3 * ARM_M:g} mm."
    )


def _name_worst(rows: list[engines.EngineMuscle]) -> abc.Iterator[str]:
    for row in (row for k, row in enumerate(rows[:_TOLD]) if not (k and row.within)):
        why = f": {'; '.join(row.causes)}" if row.causes else ""
        yield (
            f"{row.muscle}: length off by {row.length_mm:.2f} mm at {row.length_at} {row.length_at_deg:.0f}"
            f" degrees, moment arm by {row.moment_arm_mm:.2f} mm at {row.moment_arm_at}"
            f" {row.moment_arm_at_deg:.0f} degrees{why}."
        )


def write_check(folder: Path, found: MuscleCheck) -> None:
    """Write ``model_muscles.csv``: each muscle's length and moment arm along the sweeps that move it, mm."""
    engine, reference = found.engine, found.reference
    with (folder / "model_muscles.csv").open("w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream)
        measures = [f"{what}_{who}_mm" for what in ("length", "moment_arm") for who in ("mujoco", "opensim")]
        rows.writerow(["coordinate", "value_deg", "muscle", *measures])
        for n, (name, x) in enumerate(found.sweeps.items()):
            frames = slice(n * STEPS, (n + 1) * STEPS)
            arms = None if reference is None else _gather_arms(reference, name, frames)
            for k, muscle in enumerate(engine.muscles):
                columns = [engine.lengths[name][:, k], np.full(len(x), np.nan)]
                columns += [engine.arms[name][:, k], np.full(len(x), np.nan)]
                if reference is not None and arms is not None:
                    own = reference.muscles.index(muscle)
                    columns[1], columns[3] = reference.lengths[frames, own], arms[:, own]
                if np.nanmax(np.abs(columns[2:])) < _NO_ARM:
                    continue
                for value, *numbers in zip(np.degrees(x), *(1e3 * c for c in columns), strict=True):
                    cells = ("" if np.isnan(number) else f"{number:.3f}" for number in numbers)
                    rows.writerow([name, f"{value:.2f}", muscle, *cells])
