"""Dynamics onto disk: complete, or nothing at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scaling_service.capabilities.dynamics.document import DynamicsDocument
from scaling_service.capabilities.dynamics.documents import dynamics_document
from scaling_service.capabilities.dynamics.model_files import write_massive_model
from scaling_service.capabilities.dynamics.report.data import DynamicsData, ResidualCurves
from scaling_service.capabilities.dynamics.report.page import dynamics_page
from scaling_service.capabilities.dynamics.residuals import COMPONENTS
from scaling_service.capabilities.dynamics.run import DynamicsResults
from scaling_service.capabilities.dynamics.trial import TrialDynamics
from scaling_service.documents.writing import REPORT, all_or_nothing, write_json
from scaling_service.files.sto import Table, write_sto
from scaling_service.model.body import BodyModel

FILE_NAME = "dynamics.json"


def save_dynamics(results: DynamicsResults, folder: str | Path, *, report: bool = True) -> DynamicsDocument:
    """Write ``<trial>_id.sto`` of every trial, ``dynamics.json`` and ``report.html`` into a folder.

    Where inertia was identified, ``model.json`` and ``model.osim`` are the model with it.

    Parameters
    ----------
    results : DynamicsResults
    folder : path
        Made if it does not exist. Other files in it stay.
    report : bool
        Whether to write ``report.html``.

    Returns
    -------
    DynamicsDocument
        What was written as ``dynamics.json``.

    Raises
    ------
    InputError
        The folder cannot be made or written to.
    """
    with all_or_nothing(Path(folder)) as scratch:
        for name, found in results.trials.items():
            write_sto(scratch / f"{name}_id.sto", forces_table(name, found, results.prepared.model))
        notes: tuple[str, ...] = ()
        if results.inertial is not None:
            scaling = results.prepared.calibration
            factors = {} if scaling is None else scaling.scale_factors
            notes = write_massive_model(scratch, results.inertial.model, results.prepared, factors)
        files = sorted(path.name for path in scratch.iterdir())
        document = dynamics_document(results, files, notes)
        write_json(scratch / FILE_NAME, document)
        if report:
            (scratch / REPORT).write_text(
                dynamics_page(report_data(results, document)).html(), encoding="utf-8"
            )
    return document


def report_data(results: DynamicsResults, document: DynamicsDocument) -> DynamicsData:
    """What the report shows; frames that do not count are gaps."""
    curves = {
        name: ResidualCurves(
            found.dynamics.motion.times,
            np.where(found.frames[:, None], found.dynamics.residual, np.nan),
        )
        for name, found in results.trials.items()
    }
    return DynamicsData(document, curves)


def forces_table(name: str, found: TrialDynamics, model: BodyModel) -> Table:
    """Generalised forces under the names of OpenSim's inverse dynamics tool, and the residual in ground axes.

    ``hip_flexion_r_moment`` is in N m, ``pelvis_tx_force`` in N; ``residual_fx`` … ``residual_mz`` in N and
    N m, moments about the root segment's origin. Frames that are not known are NaN.
    """
    suffix = {c.name: "moment" if c.kind == "rotation" else "force" for c in model.coordinates}
    dynamics = found.dynamics
    columns = [f"{coordinate}_{suffix[coordinate]}" for coordinate in dynamics.coordinates]
    return Table(
        name,
        ("time", *columns, *(f"residual_{component}" for component in COMPONENTS)),
        np.column_stack([dynamics.motion.times, dynamics.forces, dynamics.residual]),
        in_degrees=False,
    )
