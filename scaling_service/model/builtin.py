"""The body models that come with the product, by name.

Their numbers, each with its source, are in the data folder ``reference_models``.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import yaml

from scaling_service.core.errors import InputError
from scaling_service.model.body import BodyModel
from scaling_service.model.compact import GenericPerson, expand
from scaling_service.model.reference import reference_folder as reference_folder

BUILTIN_NAMES: tuple[str, ...] = (
    "lower_limb_14dof",
    "lower_limb_feet_18dof",
    "full_body_35dof",
    "squat_4dof",
)
"""Puchaud 2019 (section 2.2.1), the same with feet, Muller 2017 (section 2.3) and Futamure (section II.A)."""


def builtin(name: str) -> BodyModel:
    """A built-in generic model.

    Parameters
    ----------
    name : str
        One of ``BUILTIN_NAMES``.

    Raises
    ------
    InputError
        If there is no such model; the names are listed.

    Examples
    --------
    >>> builtin("lower_limb_14dof").segment_names
    ('pelvis', 'femur_r', 'tibia_r', 'femur_l', 'tibia_l')
    """
    return _load(_known(name))[0]


def generic_person(name: str) -> GenericPerson:
    """The stature, mass and sex that a built-in model's numbers belong to; errors as :func:`builtin`."""
    return _load(_known(name))[1]


def _known(name: str) -> str:
    if name not in BUILTIN_NAMES:
        raise InputError(
            f"there is no built-in model '{name}'",
            field="model",
            remedy=f"Use one of {', '.join(BUILTIN_NAMES)}, or the path of an .osim file",
        )
    return name


@cache
def _load(name: str) -> tuple[BodyModel, GenericPerson]:
    document = _read(name)
    base = document.get("extends")
    return expand(document, file=f"{name}.yaml", base=_load(_known(base)) if base else None)


def _read(name: str) -> dict[str, Any]:
    document = yaml.safe_load((reference_folder() / f"{name}.yaml").read_text(encoding="utf-8"))
    if not isinstance(document, dict):
        raise InputError("the model is not a mapping", file=f"{name}.yaml", remedy="Reinstall the package")
    return document
