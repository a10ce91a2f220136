"""What a look at recordings shows: trajectories and forces as binary tables, and who stood on which plate."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.intake import files as intake_files
from scaling_service.capabilities.intake import result as documents
from scaling_service.capabilities.intake.standing import sort_by_segment
from scaling_service.capabilities.kinetics.forces import turn_forces
from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.documents import base
from scaling_service.files import table_files
from scaling_service.model.anatomy.frames import SIDES
from scaling_service.model.anatomy.markers import is_computed
from scaling_service.model.forces import CONTACT_N, GroundForces
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.problem import find_seen
from scaling_service.numerics.signals.filters import find_runs
from scaling_service.recording import orientation, plates_feet

WALKED_M = 1.0  # chosen: who goes this far over the floor walks; squats and leg swings stay below

Vector = tuple[float, float, float]

NEAR_M = 0.25
"""Chosen: pressure farther than this over the floor from every marker of a foot is not that foot's (a foot's
length from heel to toes, for feet that bear few markers)."""

BESIDE_M = 0.1  # chosen: soles reach this far from the markers

OFFSET_N = 10.0
"""Chosen: plates at rest read less; what they read shifts the centre of pressure by millimetres only."""

STEADY = 0.3
"""Chosen: an offset changes by less than this share of itself; somebody or something on the plate moves."""

BRIEF_S = 0.05  # chosen: briefer loads are knocks
RESTS_M_S = 0.3  # chosen: a standing foot stays below, skin included; a swinging one reaches 3 to 4
SAME_S = 0.1  # chosen: events of one foot nearer than this are one; a step takes four times as long
_BOTH = 0.3  # chosen: share of a contact that a foot must be there
_FEWEST = 10  # frames that tell an offset

_FEET: abc.Mapping[str, str] = {"r": "right foot", "l": "left foot"}


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Forces of one recording at its frames, and where they came from."""

    source: str
    forces: GroundForces


def check_recording(
    item: intake_files.RecordingFile,
    axes: orientation.Orientation,
    ground: Ground | None,
    given: tuple[str | None, str | None],
    files: table_files.ArrayFiles,
    *,
    events_given: bool,
) -> tuple[documents.RecordingProof, Trial, GroundForces | None]:
    """One recording as it travels, its tables written, and it with its forces in the session's axes.

    ``axes``: the session's. ``ground``: forces in the laboratory's axes. ``given`` (up, forward): axes as
    given. ``events_given``: whether the document says its events.

    Raises InputError: the unit of its positions cannot be told.
    """
    trial = orientation.apply(axes, item.trial)
    turned, problems = _turn(ground, axes)
    distance, direction = measure_walk(trial)
    plates: list[base.PlateEntry] = []
    contacts: list[Contact] = []
    force = pressure = ground_forces = None
    if turned is not None:
        # Tables of force and pressure, plates, and who stood on them. Corners and types are known of the
        # recording's own plates only.
        ground_forces = turned.change(
            times=trial.times,
            force=table_files.sample_at(turned.times, turned.force, trial.times),
            moment=table_files.sample_at(turned.times, turned.moment, trial.times),
            read=None,
        )
        own = item.corners if len(item.plates) == len(turned.plates) else None
        entries = table_files.list_plates(turned, None if own is None else axes.rotate(own))
        kinds = () if own is None else tuple(plate.kind for plate in item.plates)
        plates, contacts = describe_plates(entries, ground_forces, trial, kinds)
        force = files.write(f"{item.file}.force", ground_forces.force, "N")
        pressure = files.write(f"{item.file}.pressure", ground_forces.centre_of_pressure(), "m")
    labels = []
    for k in range(len(trial.labels)):
        shown = find_seen(trial.markers[:, k])
        gaps = [(int(first), int(stop) - 1) for first, stop in find_runs(~shown)]
        longest = max((last - first + 1 for first, last in gaps), default=0)
        labels.append(
            documents.LabelEntry(
                label=trial.labels[k],
                seen=round(float(shown.mean()), 4),
                gaps=gaps,
                longest_gap_s=round(longest / trial.rate_hz, 4),
                computed=is_computed(trial.labels[k]),
            )
        )
    entry = documents.RecordingProof(
        name=trial.name,
        file=item.file,
        format=item.file.rpartition(".")[2].upper(),
        unit=item.trial.unit,
        rate_hz=trial.rate_hz,
        frames=trial.n_frames,
        start_s=float(trial.times[0]),
        axes=intake_files.make_axes_entry(item.axes, *given),
        walked_m=round(distance, 3),
        direction=direction,
        labels=labels,
        markers=files.write(f"{item.file}.markers", trial.markers, "m"),
        plates=plates,
        events=list_events(trial, contacts, given=events_given),
        forces_from=None if ground is None or turned is None else ground.source,
        force=force,
        centre_of_pressure=pressure,
        repairs=[
            documents.RepairEntry.model_validate(repair, from_attributes=True)
            for repair in (*trial.repairs, *(() if turned is None else turned.repairs))
        ],
        problems=[*item.problems, *problems],
    )
    return entry, trial, ground_forces


def _turn(
    ground: Ground | None, axes: orientation.Orientation
) -> tuple[GroundForces | None, list[documents.ProblemEntry]]:
    """Forces in our axes, or why they cannot be had."""
    if ground is None:
        return None, []
    try:
        return turn_forces(Path(ground.source), ground.forces, axes), []
    except InputError as error:
        return None, [intake_files.make_problem(error, "warning", ground.source)]


@dataclass(frozen=True, slots=True)
class Contact:
    """A plate is loaded from the frame ``start`` up to ``stop``, by the feet of these sides."""

    start: int
    stop: int
    who: tuple[str, ...]


_Kind = Literal["strike", "off"]


def list_events(trial: Trial, contacts: abc.Sequence[Contact], *, given: bool) -> list[documents.EventProof]:
    """The recording's events of gait by time; those of plates where nobody else says when that is.

    A contact that one foot alone makes begins and ends with an event, unless the recording does.
    """
    said = [
        documents.EventProof(
            side=event.side,
            kind=event.kind,
            time_s=round(event.time_s, 4),
            source="document" if given else "file",
        )
        for event in trial.events
    ]
    found = list(said)
    for contact in () if given else contacts:
        ends: tuple[tuple[_Kind, int], ...] = (("strike", contact.start), ("off", contact.stop))
        for side in SIDES:
            for kind, frame in ends:
                if contact.who != (side,) or not 0 < frame < trial.n_frames:
                    continue
                at = float(trial.times[frame])
                known = [one for one in said if (one.side, one.kind) == (side, kind)]
                if all(abs(one.time_s - at) > SAME_S for one in known):
                    found.append(
                        documents.EventProof(side=side, kind=kind, time_s=round(at, 4), source="plates")
                    )
    return sorted(found, key=lambda one: one.time_s)


def measure_walk(trial: Trial) -> tuple[float, Vector | None]:
    """How far the markers' middle went over the floor from first to last frame, m, and which way."""
    rows = np.flatnonzero(find_seen(trial.markers).any(axis=1))
    if len(rows) < 2:
        return 0.0, None
    first, last = (np.nanmedian(trial.markers[row], axis=0) for row in (rows[0], rows[-1]))
    way = (last - first) * [1.0, 0.0, 1.0]
    distance = float(np.linalg.norm(way))
    if distance < WALKED_M:
        return distance, None
    x, y, z = (round(float(v), 4) for v in way / distance)
    return distance, (x, y, z)


def describe_plates(
    entries: list[base.PlateEntry], forces: GroundForces, trial: Trial, kinds: tuple[int, ...]
) -> tuple[list[base.PlateEntry], list[Contact]]:
    """Plates with type, place, who stood on them and when, and their offset.

    ``forces``: at the times of the trial, in its axes. ``trial``: X forward, Y up, Z right, m. ``kinds``:
    types of the plates; empty for forces of tables.
    """
    # Side to the places of its foot's markers over the floor, (n, m, 2); else those of the shank's.
    clusters = sort_by_segment(trial.labels)
    feet, overhang = {}, {}
    for side in _FEET:
        on = [*clusters.get(f"calcn_{side}", []), *clusters.get(f"toes_{side}", [])]
        if on and forces.corners is not None:
            overhang[side] = plates_feet.measure_overhang(
                forces.corners, np.stack([trial.position(label) for label in on], axis=1)
            )
        on = on or clusters.get(f"tibia_{side}", [])
        if on:
            feet[side] = np.stack([trial.position(label)[:, [0, 2]] for label in on], axis=1)
    # Frames that hide a foot, which may be on any plate: what is not seen is not absent.
    shown = [find_seen(foot).any(axis=1) for foot in feet.values()]
    hidden = ~np.all(shown, axis=0) if len(feet) == len(_FEET) else np.ones(trial.n_frames, dtype=bool)
    centre, pressing = forces.centre_of_pressure(), forces.pressing
    described = []
    contacts: list[Contact] = []
    for k, entry in enumerate(entries):
        place = forces.surfaces[k] if entry.corners_m is None else np.mean(entry.corners_m, axis=0)
        away = {side: _measure_distance(foot, centre[:, k]) for side, foot in feet.items()}
        nearest = np.min(list(away.values()), axis=0) if away else np.array([])
        stands = {side: (distance < NEAR_M) & (distance == nearest) for side, distance in away.items()}
        near = [hidden, *(distance < NEAR_M for distance in away.values())]
        if entry.corners_m is not None:
            low, high = (f(np.asarray(entry.corners_m)[:, [0, 2]], axis=0) for f in (np.min, np.max))
            for foot in feet.values():
                # Frames in which a marker of a foot is over a plate, between its ends along x and z, or
                # beside it
                with np.errstate(invalid="ignore"):
                    beside = np.asarray(((foot > low - BESIDE_M) & (foot < high + BESIDE_M)).all(axis=2))
                near.append(np.asarray(beside.any(axis=1)))
            stands = {
                side: stands[side] | _is_at_rest(foot, low, high, trial.rate_hz)
                for side, foot in feet.items()
            }
        offset = _measure_offset(pressing[:, k], ~np.any(near, axis=0)) if feet else None
        loaded = pressing[:, k] > CONTACT_N + abs(offset or 0.0)
        own: list[Contact] = []
        if feet:
            own = [
                Contact(
                    int(start),
                    int(stop),
                    tuple(side for side, on in stands.items() if on[start:stop].mean() > _BOTH),
                )
                for start, stop in find_runs(loaded)
                if stop - start >= BRIEF_S * trial.rate_hz
            ]
        contacts += own
        said = []
        for one in own:
            rows = slice(one.start, one.stop)
            beyond = [overhang[s][rows][stands[s][rows]] for s in one.who if s in overhang]
            reach = np.concatenate([[-np.inf], *beyond]).max()
            nobody = "a foot that is not seen" if hidden[rows].mean() > _BOTH else "nobody"
            who = " and ".join(_FEET[side] for side in one.who) or nobody
            edge = f", {1e3 * reach:.0f} mm over its edge" if reach > plates_feet.EDGE_M else ""
            said.append(f"{who} {trial.times[one.start]:.2f}–{trial.times[one.stop - 1]:.2f} s{edge}")
        changes = {
            "kind": kinds[k] if k < len(kinds) else None,
            "centre_m": [round(float(v), 3) for v in place],
            "loaded_by": said,
            "offset_N": offset,
        }
        described.append(entry.model_copy(update=changes))
    return described, contacts


def _measure_distance(foot: Array, centre: Array) -> Array:
    """From the pressure to the nearest marker of a foot over the floor, m; infinite where there is none."""
    away = np.linalg.norm(foot - centre[:, None, [0, 2]], axis=2)
    return np.asarray(np.where(np.isfinite(away), away, np.inf).min(axis=1))


def _is_at_rest(foot: Array, low: Array, high: Array, rate_hz: float) -> NDArray[np.bool_]:
    """Frames in which the middle of a foot is over a plate and hardly moves."""
    known = find_seen(foot)
    middle = np.where(known[..., None], foot, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)[:, None]
    over = known.any(axis=1) & ((middle > low) & (middle < high)).all(axis=1)
    if len(middle) < 2:
        return np.asarray(over)
    speed = np.linalg.norm(np.gradient(middle, axis=0), axis=1) * rate_hz
    return np.asarray(over & (speed < RESTS_M_S))


def _measure_offset(pressing: Array, alone: NDArray[np.bool_]) -> float | None:
    """The steady reading while both feet are seen elsewhere, N; None where there is none."""
    rows = alone & np.isfinite(pressing)
    if rows.sum() < _FEWEST:
        return None
    low, middle, high = np.quantile(pressing[rows], [0.25, 0.5, 0.75])
    steady = high - low <= max(STEADY * abs(middle), 0.25 * CONTACT_N)
    return round(float(middle), 1) if steady else None
