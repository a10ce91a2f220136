"""From dynamics in memory to ``dynamics.json``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scaling_service.capabilities.dynamics.document import (
    CombinationChange,
    CombinationPart,
    DynamicsDocument,
    IdentificationDocument,
    InertialChange,
    JointLoad,
    ResidualGate,
    Six,
    TrialDynamicsDocument,
    UncertaintyDocument,
    Wrench,
    WrenchFitDocument,
)
from scaling_service.capabilities.dynamics.inertia.result import InertialIdentification
from scaling_service.capabilities.dynamics.run import DynamicsResults
from scaling_service.capabilities.dynamics.trial import TrialDynamics
from scaling_service.capabilities.dynamics.uncertainty.total import WrenchUncertainty
from scaling_service.capabilities.subject.hashes import input_hashes
from scaling_service.capabilities.subject.provenance import repair_notes
from scaling_service.documents.writing import code_version
from scaling_service.model.massive import total_mass
from scaling_service.model.trial import Repair

_DIGITS = 6
"""Significant figures; forces are not known to more than three."""


def dynamics_document(
    results: DynamicsResults, files: Sequence[str] = (), notes: Sequence[str] = ()
) -> DynamicsDocument:
    """``dynamics.json``, with the files and notes that writing them added."""
    prepared = results.prepared
    session = prepared.loaded.session
    fitted = {trial.name for trial in session.calibration}
    return DynamicsDocument(
        code_version=code_version(),
        subject=prepared.subject.id,
        settings=results.settings.resolved() | {"dynamics": asdict(results.chosen)},
        input_hashes=input_hashes(prepared.subject, results.subject_file),
        seed=results.settings.seed,
        markers_used={name: list(labels) for name, labels in prepared.loaded.markers_used.items()},
        repairs={
            trial.name: repair_notes(
                [
                    *trial.repairs,
                    *(prepared.forces[trial.name].repairs if trial.name in results.trials else ()),
                ]
            )
            for trial in session.dynamic
        },
        start=prepared.start,
        inertia=prepared.inertia,
        mass_kg=_rounded(total_mass(prepared.model)),
        height_m=prepared.height_m,
        trials={
            name: _trial(found, "calibration" if name in fitted else "evaluation", results)
            for name, found in results.trials.items()
        },
        verdict=results.verdict,
        inertial=None if results.inertial is None else _identification(results.inertial, results),
        warnings=[*results.warnings, *notes],
        files=list(files),
        wall_s=round(results.wall_s, 3),
    )


def wrench(values: ArrayLike) -> Wrench:
    """Six numbers by their names."""
    fx, fy, fz, mx, my, mz = six(values)
    return Wrench(fx_N=fx, fy_N=fy, fz_N=fz, mx_Nm=mx, my_Nm=my, mz_Nm=mz)


def six(values: ArrayLike) -> Six:
    """Six numbers, rounded."""
    fx, fy, fz, mx, my, mz = (_rounded(float(v)) for v in np.asarray(values, dtype=float))
    return (fx, fy, fz, mx, my, mz)


def _trial(found: TrialDynamics, role: str, results: DynamicsResults) -> TrialDynamicsDocument:
    residuals = found.residuals
    return TrialDynamicsDocument(
        role="calibration" if role == "calibration" else "evaluation",
        forces_from=found.forces.source.name,
        frames=residuals.frames,
        left_out=residuals.left_out,
        residual_rms=wrench(residuals.rms),
        dr=six(residuals.dr),
        gates=[
            ResidualGate(
                name=gate.name,
                source=gate.source,
                value=_rounded(gate.value),
                limit=_rounded(gate.limit),
                unit="N m" if gate.unit == "N m" else "N",
                passed=gate.passed,
            )
            for gate in residuals.gates
        ],
        joint_loads=_joint_loads(found, results),
        **_uncertainty(found.uncertainty),
        warnings=list(found.warnings),
    )


def _uncertainty(found: WrenchUncertainty) -> dict[str, Any]:
    return {
        "reconstruction_error_mm": _rounded(1e3 * found.reconstruction_error_m),
        "uncertainty": UncertaintyDocument(
            kinematic=six(found.kinematic), plate=six(found.plate), total=six(found.total)
        ),
        "slopes_per_cm": six(found.slopes_per_cm),
        "r2": six(found.r2),
        "calibration_supported": found.calibration_supported.tolist(),
    }


def _joint_loads(found: TrialDynamics, results: DynamicsResults) -> dict[str, JointLoad]:
    kinds = {c.name: c.kind for c in results.prepared.model.coordinates}
    forces = found.dynamics.forces[found.frames]
    return {
        name: JointLoad(
            unit="N m" if kinds[name] == "rotation" else "N",
            peak=_rounded(float(np.abs(forces[:, k]).max())),
            rms=_rounded(float(np.sqrt((forces[:, k] ** 2).mean()))),
        )
        for k, name in enumerate(found.dynamics.coordinates)
    }


def _identification(found: InertialIdentification, results: DynamicsResults) -> IdentificationDocument:
    ratio = found.relative_error(held_out=True)
    fx, fy, fz, mx, my, mz = found.components
    return IdentificationDocument(
        components=(fx, fy, fz, mx, my, mz),
        total_mass_kg=(_rounded(total_mass(results.prepared.model)), _rounded(total_mass(found.model))),
        trials={
            fit.trial: WrenchFitDocument(
                held_out=fit.held_out, frames=fit.frames, before=wrench(fit.before), after=wrench(fit.after)
            )
            for fit in found.fits
        },
        held_out_ratio=None if np.isnan(ratio) else _rounded(ratio),
        combinations=[
            CombinationChange(
                parts=[
                    CombinationPart(segment=segment, quantity=quantity, weight=_rounded(weight))
                    for segment, quantity, weight in c.shares
                ],
                gain=_rounded(c.gain),
                moved=_rounded(c.moved),
                sd=_rounded(c.sd),
            )
            for c in found.combinations
        ],
        parameters=[
            InertialChange(
                segment=p.segment,
                quantity=p.quantity,
                unit="kg" if p.quantity == "mass" else "m" if p.quantity.startswith("com") else "kg m2",
                before=_rounded(p.before),
                after=_rounded(p.after),
                prior_sd=_rounded(p.prior_sd),
                sd=_rounded(p.sd),
                moved=_rounded(p.moved),
                identifiable=p.identifiable,
            )
            for p in found.parameters
        ],
        warnings=list(found.warnings),
    )


def _of_forces(results: DynamicsResults, name: str) -> tuple[Repair, ...]:
    found = results.trials.get(name)
    return () if found is None else found.forces.repairs


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
