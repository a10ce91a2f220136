"""Scaled models in the forms of other engines, and how near their muscles are to OpenSim's."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scaling_service.capabilities.scaling.muscles import engine
from scaling_service.core import errors
from scaling_service.documents.writing import write_json
from scaling_service.files.engines import ENGINES
from scaling_service.files.limbs import Skeleton
from scaling_service.files.osim.models import replace_text
from scaling_service.files.osim.muscles import read_musculature
from scaling_service.model.body import BodyModel
from scaling_service.model.muscles import Musculature
from scaling_service.model.poses import sweep_coordinates

_STEPS = 21
"""Of each coordinate's range, in which surfaces are touched. Chosen: not those of the comparison."""


def export_models(folder: Path, model: BodyModel, osim: str | None, forms: Sequence[str]) -> list[str]:
    """Write a model as ``model.xml`` (mjcf) and ``model.bioMod``, and what that changes as sentences.

    With muscles ``model_muscles.json`` and ``model_muscles.csv`` hold MuJoCo's beside OpenSim's.

    ``model``: without parameters. ``osim``: the text of its ``.osim`` file; without it there are no muscles.
    ``forms``: keys of ``files.engines.ENGINES``.
    """
    muscles, said = None, list[str]()
    if osim is not None:
        try:
            poses = np.concatenate(list(sweep_coordinates(model, _STEPS).values()))
            found = read_musculature(osim, model, poses)
            muscles = found if found.muscles else None
        except errors.InputError as error:
            said.append(f"muscles were not exported: {error}")
    for form in forms:
        file, write = ENGINES[form]
        try:
            exported = write(model, muscles)
        except errors.ModelRefused as error:
            said.append(f"{file} was not written: {error}")
            continue
        replace_text(folder / file, exported.text)
        said += [f"{file}: {each}" for each in exported.left_out]
        if form == "mjcf" and muscles is not None:
            said += _check(folder, model, osim or "", muscles, exported)
    return said


def _check(folder: Path, model: BodyModel, osim: str, muscles: Musculature, exported: Skeleton) -> list[str]:
    try:
        found = engine.check_muscles(model, osim, muscles, exported)
    except errors.DependencyMissing as error:
        return [f"model.xml's muscles were not held against OpenSim's: {error}"]
    engine.write_check(folder, found)
    write_json(folder / "model_muscles.json", found.document)
    return found.document.summary
