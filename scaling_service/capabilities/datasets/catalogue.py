"""The catalogue of public recordings that comes with the product."""

from __future__ import annotations

import difflib
from importlib.resources.abc import Traversable

import yaml
from pydantic import ValidationError

from scaling_service.capabilities.datasets.document import CatalogueDocument, Dataset
from scaling_service.core.errors import InputError
from scaling_service.model.reference import reference_folder

FILE_NAME = "datasets.yaml"


def read_catalogue(file: Traversable | None = None) -> dict[str, Dataset]:
    """All datasets by name, in the catalogue's order.

    Parameters
    ----------
    file : path, optional
        Another catalogue than the one that comes with the product.

    Raises
    ------
    InputError
        The file does not follow ``CatalogueDocument``.

    Examples
    --------
    >>> "jia_mri" in read_catalogue()
    True
    """
    source = reference_folder() / FILE_NAME if file is None else file
    try:
        content = yaml.safe_load(source.read_text(encoding="utf-8"))
        return dict(CatalogueDocument.model_validate(content).datasets)
    except (OSError, UnicodeDecodeError, yaml.YAMLError, ValidationError) as error:
        raise InputError(
            f"the catalogue of datasets cannot be used: {_first_line(error)}",
            file=FILE_NAME,
            remedy="Install the program again",
        ) from None


def find_dataset(name: str, catalogue: dict[str, Dataset]) -> Dataset:
    """One dataset by name.

    Raises
    ------
    InputError
        There is none of that name; close ones, or all, are told.
    """
    if name in catalogue:
        return catalogue[name]
    close = difflib.get_close_matches(name.lower(), catalogue, n=1, cutoff=0.5)
    guess = f"Did you mean '{close[0]}'? " if close else ""
    raise InputError(
        f"there is no dataset '{name}'", field="NAME", remedy=f"{guess}There are {', '.join(catalogue)}"
    )


def _first_line(error: Exception) -> str:
    if isinstance(error, ValidationError):
        first = error.errors(include_url=False)[0]
        return f"{'.'.join(str(part) for part in first['loc'])}: {first['msg']}"
    return str(error).splitlines()[0]
