"""Dynamics onto disk: complete, or nothing at all."""

from __future__ import annotations

from collections import abc
from pathlib import Path
from typing import TypeVar

import numpy as np
from pydantic import BaseModel

from scaling_service.capabilities.dynamics import result, words
from scaling_service.capabilities.dynamics.start import Prepared
from scaling_service.capabilities.kinetics.inverse_dynamics import COMPONENTS
from scaling_service.capabilities.playback.scene import FOLDER
from scaling_service.core.errors import DependencyMissing
from scaling_service.core.tables import ResultTable
from scaling_service.documents import writing
from scaling_service.files import sto as sto_files
from scaling_service.files.model_json import write_model_json
from scaling_service.files.osim.models import write_osim
from scaling_service.files.table_files import ArrayFiles
from scaling_service.model import freed
from scaling_service.model.body import BodyModel
from scaling_service.report import onefile

FILE_NAME = "dynamics.json"

RESIDUALS_FILE = f"{FOLDER}/residuals.json"

Written = TypeVar("Written", bound=BaseModel)


def save_dynamics(
    results: result.DynamicsResults, folder: str | Path, *, report: bool = True
) -> result.DynamicsDocument:
    """Write ``<trial>_id.sto`` of every trial, ``dynamics.json`` and ``report.html`` into a folder.

    Where inertia was identified, ``model.json`` and ``model.osim`` are the model with it.

    Parameters
    ----------
    results : DynamicsResults
        From :func:`dynamics`.
    folder : path
        Made if it does not exist. Other files in it stay.
    report : bool
        Whether to write ``report.html``.

    Returns
    -------
    DynamicsDocument
        What was written as ``dynamics.json``: N and N m.

    Raises
    ------
    InputError
        The folder cannot be made or written to.

    Examples
    --------
    >>> import scaling_service as ss
    >>> checked = ss.dynamics("plates/subject.json", ss.DynamicsSettings(start="none"))
    >>> document = ss.save_dynamics(checked, "checked", report=False)
    >>> list(document.trials)
    ['sway', 'swing']
    """
    with writing.all_or_nothing(Path(folder)) as scratch:
        for name, found in results.trials.items():
            sto_files.write_sto(
                scratch / f"{name}_id.sto", _tabulate_forces(name, found, results.prepared.model)
            )
        notes: tuple[str, ...] = ()
        if results.inertial is not None:
            scaling = results.prepared.calibration
            factors = {} if scaling is None else scaling.scale_factors
            notes = write_massive_model(scratch, results.inertial.model, results.prepared, factors)
        document = write_document(scratch / FILE_NAME, results.document, [*results.document.warnings, *notes])
        if report:
            # `report.html`: the check's views with the residuals over time.
            files = onefile.collect_files(lambda folder: write_residuals(results, folder, brief=True))
            onefile.Report(
                kind="dynamics",
                name=FILE_NAME,
                summary=words.summarise(document),
                document=document,
                files=files,
                beside=document.files,
            ).write(scratch)
    return document


def write_document(path: Path, document: Written, warnings: list[str]) -> Written:
    """Write a result's document with the names of what lies beside it and all warnings; it as written."""
    files = sorted(file.name for file in path.parent.iterdir())
    document = document.model_copy(update={"files": files, "warnings": warnings})
    writing.write_json(path, document)
    return document


def _tabulate_forces(name: str, found: result.TrialDynamics, model: BodyModel) -> sto_files.Table:
    """Generalised forces under the names of OpenSim's inverse dynamics tool, and the residual in ground axes.

    ``hip_flexion_r_moment`` is in N m, ``pelvis_tx_force`` in N; ``residual_fx`` … ``residual_mz`` in N and
    N m, moments about the root segment's origin. Frames that are not known are NaN.
    """
    suffix = {c.name: "moment" if c.kind == "rotation" else "force" for c in model.coordinates}
    dynamics = found.dynamics
    columns = [f"{coordinate}_{suffix[coordinate]}" for coordinate in dynamics.coordinates]
    return sto_files.Table(
        name=name,
        columns=("time", *columns, *(f"residual_{component}" for component in COMPONENTS)),
        data=np.column_stack([dynamics.motion.times, dynamics.forces, dynamics.residual]),
        in_degrees=False,
    )


def tabulate_loads(results: result.DynamicsResults) -> dict[str, ResultTable]:
    """Joint loads and the residual of every recording over time, N and N m; see ``<trial>_id.sto``."""
    tables = {}
    for name, found in results.trials.items():
        sto = _tabulate_forces(name, found, results.prepared.model)
        units = ("N" if c.endswith("_force") or c.startswith("residual_f") else "Nm" for c in sto.columns[1:])
        columns = ("time_s", *(f"{c}_{unit}" for c, unit in zip(sto.columns[1:], units, strict=True)))
        tables[f"loads_{name}"] = ResultTable(name, columns, tuple(map(tuple, sto.data.tolist())))
    return tables


def write_massive_model(
    folder: Path, model: BodyModel, prepared: Prepared, factors: abc.Mapping[str, tuple[float, float, float]]
) -> tuple[str, ...]:
    """Write a model whose inertia was found as model.json and model.osim; tells what the latter lacks.

    ``factors`` are each segment's scale factors along X, Y, Z, for OpenSim's own scaling.
    """
    write_model_json(folder / "model.json", model)
    subject, scaling = prepared.subject, prepared.calibration
    is_file = subject.model.lower().endswith(".osim")
    held = freed.hold_markers(model)
    try:
        write_osim(
            folder / "model.osim",
            held,
            source=Path(subject.model) if is_file else None,
            factors=factors,
            axis_tilts={} if scaling is None else scaling.axis_tilts,
            joint_moves={} if scaling is None else scaling.joint_moves,
            marker_set=subject.marker_set,
            inertia_from_model=True,
        )
    except DependencyMissing as error:
        return (f"model.osim was not written: {error}",)
    return () if held == model else (freed.MARKERS_HELD,)


def write_residuals(
    results: result.DynamicsResults, outputs: Path, *, brief: bool = False
) -> result.ResidualScene:
    """Write ``scene/residuals.json`` with its tables.

    ``outputs``: the folder of the job's files. ``brief``: whether numbers are kept in brief.
    """
    files = ArrayFiles(outputs, FOLDER, brief=brief)
    found = {}
    for name, trial in results.trials.items():
        times = trial.dynamics.motion.times
        values = np.where(trial.frames[:, None], trial.dynamics.residual, np.nan)
        found[name] = result.ResidualTrial(
            start_s=float(times[0]),
            rate_hz=round(1.0 / float(np.median(np.diff(times))), 6),
            residual=files.write(f"{name}.residual", values, "N, N m"),
        )
    document = result.ResidualScene(trials=found)
    writing.write_json(outputs / RESIDUALS_FILE, document)
    return document
