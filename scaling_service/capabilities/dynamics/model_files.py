"""A model whose inertia was found, as model.json and model.osim."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from scaling_service.capabilities.dynamics.start import Prepared
from scaling_service.core.errors import DependencyMissing
from scaling_service.files.osim import write_osim
from scaling_service.model.body import BodyModel
from scaling_service.model.document import to_document


def write_massive_model(
    folder: Path, model: BodyModel, prepared: Prepared, factors: Mapping[str, tuple[float, float, float]]
) -> tuple[str, ...]:
    """Write both files.

    Parameters
    ----------
    model : BodyModel
        With its inertia.
    prepared : Prepared
        What it started from.
    factors : mapping
        Segment to its scale factors along X, Y, Z, for OpenSim's own scaling.

    Returns
    -------
    tuple of str
        What is to be told: why model.osim could not be written.
    """
    content = json.dumps(to_document(model), indent=1, allow_nan=False)
    (folder / "model.json").write_text(content + "\n", encoding="utf-8")
    subject, scaling = prepared.subject, prepared.calibration
    is_file = subject.model.lower().endswith(".osim")
    try:
        write_osim(
            folder / "model.osim",
            model,
            source=Path(subject.model) if is_file else None,
            factors=factors,
            axis_tilts={} if scaling is None else scaling.axis_tilts,
            marker_set=subject.marker_set,
            inertia_from_model=True,
        )
    except DependencyMissing as error:
        return (f"model.osim was not written: {error}",)
    return ()
