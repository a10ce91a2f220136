"""Ground forces of MOT and STO files, whatever their columns are called.

A plate is found by three columns that end in ``vx``, ``vy``, ``vz``: ``ground_force_1_vx``,
``1_ground_force_vx``, ``ground_force_r_vx``, ``ground_force_vx``. Its point of application ends in ``px``;
its moment is ``…mx``, or has ``torque`` or ``moment`` in the place of ``force``.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.names import say_name
from scaling_service.files import sto
from scaling_service.model import forces
from scaling_service.model.trial import Repair

FARTHEST_M = 20.0  # chosen: a loaded point beyond this is in mm; walkways are shorter
MARGIN_M = 0.1  # chosen: how far an unloaded point may leave the places where the plate was loaded


@dataclass(frozen=True, slots=True)
class PlateColumns:
    """Names of one plate's columns; ``moment`` is empty where the file has none."""

    force: tuple[str, str, str]
    point: tuple[str, str, str]
    moment: tuple[str, ...]

    @property
    def identifier(self) -> str:
        """What the force columns have in common, as OpenSim's set-ups name it."""
        return self.force[0][:-1]


def read_forces(path: str | os.PathLike[str]) -> forces.GroundForces:
    """Read ground forces from a MOT or STO file.

    Returns in the file's axes, which OpenSim has Y up. ``repairs`` names the columns of each plate, moments
    that the file lacks, and points that had no meaning. Raises TrialUnusable: no plate is found, a point of
    application is missing, or points are in mm. Raises FileUnreadable: as ``read_sto``.
    """
    return read_forces_from_table(sto.read_sto(path), Path(path).name)


def read_forces_from_table(table: sto.Table, file: str) -> forces.GroundForces:
    """The ground forces that a table holds; errors as :func:`read_forces`."""
    plates = find_plates(table.columns, file)
    names, repairs = forces.list_plate_names(len(plates)), list(table.repairs)
    parts = [
        _read_plate(table, plate, name, file, repairs) for name, plate in zip(names, plates, strict=True)
    ]
    up = np.array([0.0, 1.0, 0.0])
    return forces.GroundForces(
        name=table.name,
        times=table.times,
        plates=names,
        force=np.stack([force for force, _, _ in parts], axis=1),
        moment=np.stack([moment for _, moment, _ in parts], axis=1),
        surfaces=np.stack([surface for _, _, surface in parts]),
        normals=np.tile(up, (len(plates), 1)),
        repairs=tuple(repairs),
    )


def find_plates(columns: tuple[str, ...], file: str) -> tuple[PlateColumns, ...]:
    """The plates that column names tell of, in the order of the columns.

    Raises TrialUnusable: there is none, or one has no point of application.
    """
    present = set(columns)
    found = []
    for name in columns:
        stem = name[:-1]
        if not name.endswith("vx") or not {f"{stem}y", f"{stem}z"} <= present:
            continue
        base = name[:-2]
        point = (f"{base}px", f"{base}py", f"{base}pz")
        missing = [p for p in point if p not in present]
        if missing:
            raise TrialUnusable(
                f"the force '{stem}' has no point of application",
                file=file,
                field=missing[0],
                remedy="Export the centre of pressure beside the force",
            )
        stems = [f"{base}m"]
        for word in ("torque", "moment"):
            other = base.replace("force", word)
            stems += [other, f"{other}m", f"{other}t"] if other != base else []
        moments = ((f"{start}x", f"{start}y", f"{start}z") for start in stems)
        moment = next((names for names in moments if present.issuperset(names)), ())
        found.append(PlateColumns((name, f"{stem}y", f"{stem}z"), point, moment))
    if not found:
        shown = ", ".join(columns[1:7]) + (", …" if len(columns) > 7 else "")
        raise TrialUnusable(
            f"no ground force is found in the columns {shown}",
            file=file,
            field="columns",
            remedy="Name the force columns as OpenSim does: ground_force_1_vx, …_vy, …_vz, …_px, …",
        )
    return tuple(found)


def _read_plate(
    table: sto.Table, plate: PlateColumns, name: str, file: str, repairs: list[Repair]
) -> tuple[Array, Array, Array]:
    """Force, moment about the origin and a point of the surface."""
    force, point = (
        np.stack([table.column(c) for c in columns], axis=1) for columns in (plate.force, plate.point)
    )
    repairs.append(Repair("plate_columns", name, f"columns {plate.identifier}x, …"))
    if plate.moment:
        moment = np.stack([table.column(c) for c in plate.moment], axis=1)
    else:
        moment = np.zeros_like(force)
        repairs.append(Repair("no_moment", name, "the file holds no moment at the point; zero was taken"))
    loaded = np.asarray(np.abs(force[:, 1]) > forces.CONTACT_N)  # of the ground on the body, or the reverse
    # Points that stay near the places where the plate is loaded; any point will do for no force.
    seen = point[loaded]
    seen = seen[np.isfinite(seen).all(axis=1)]
    if len(seen) and np.median(np.linalg.norm(seen, axis=1)) > FARTHEST_M:
        raise TrialUnusable(
            f"{say_name(name)} is loaded {np.median(np.linalg.norm(seen, axis=1)):.0f} m away from the "
            "origin",
            file=file,
            field="point of application",
            remedy="Give points in m and moments in N m",
        )
    low, high = (seen.min(axis=0), seen.max(axis=0)) if len(seen) else (np.zeros(3), np.zeros(3))
    pulled = np.clip(point, low - MARGIN_M, high + MARGIN_M)
    astray = ~loaded & np.any(np.abs(pulled - point) > 0, axis=1)
    result = np.where(astray[:, None], pulled, point)
    unloaded = np.all(force == 0, axis=1)
    undefined = ~np.all(np.isfinite(result), axis=1)
    result[unloaded & undefined] = 0.0
    counted = int(np.sum(astray & ~unloaded))
    if counted:
        detail = (
            "the point of application of a force below the threshold was far off; drawn back to the plate"
        )
        repairs.append(Repair("point_astray", name, detail, frames=counted))
    point = result
    surface = np.nanmedian(point[loaded], axis=0) if loaded.any() else np.zeros(3)
    return force, moment + np.cross(point, force), surface
