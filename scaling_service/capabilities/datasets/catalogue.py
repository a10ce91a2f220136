"""The catalogue of public recordings: what can be downloaded, from where, and on what terms."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Annotated

import pydantic

from scaling_service.core.errors import InputError
from scaling_service.core.text import suggest_name
from scaling_service.model import reference

SUBJECT_FILE = "subject.yaml"
SOURCE_FILE = "SOURCE.md"
IMAGE_MARKERS_FILE = "image_markers.csv"

BASE_URL = "https://raw.githubusercontent.com"
"""Files of public GitHub repositories: <base>/<owner>/<name>/<commit>/<path>."""

Text = Annotated[str, pydantic.StringConstraints(min_length=1, strip_whitespace=True)]
Name = Annotated[str, pydantic.StringConstraints(pattern=r"^[a-z0-9][a-z0-9_]*$", max_length=40)]
Sha256 = Annotated[str, pydantic.StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Commit = Annotated[str, pydantic.StringConstraints(pattern=r"^[0-9a-f]{40}$")]
Repository = Annotated[str, pydantic.StringConstraints(pattern=r"^[\w.-]+/[\w.-]+$")]


def _require_inside(path: str) -> str:
    """A path that stays within its folder."""
    parts = PurePosixPath(path)
    if parts.is_absolute() or ".." in parts.parts or "\\" in path or not parts.name:
        raise ValueError("a path must stay within its folder")
    return path


RelativePath = Annotated[str, pydantic.AfterValidator(_require_inside)]


class _Strict(pydantic.BaseModel):
    """No unknown keys, no conversions."""

    model_config = pydantic.ConfigDict(extra="forbid", strict=True, frozen=True)


class RemoteFile(_Strict):
    """One file of a repository, and what it must be."""

    path: RelativePath = pydantic.Field(description="In the repository.")
    saved_as: RelativePath = pydantic.Field(alias="as", description="In the folder of the dataset.")
    bytes: int = pydantic.Field(gt=0)
    sha256: Sha256


class Licence(_Strict):
    """The terms, as the repository states them."""

    name: Text
    non_commercial: bool = pydantic.Field(description="Whether commercial use is excluded.")
    note: Text | None = pydantic.Field(default=None, description="What a user must know beyond the name.")


class Dataset(_Strict):
    """One person's recordings or bones, at one commit of one repository."""

    title: Text = pydantic.Field(description="What it is, one line.")
    use: Text = pydantic.Field(description="What it is good for, one line.")
    about: Text = pydantic.Field(description="What a user must know before trusting results on it.")
    licence: Licence
    cite: tuple[Text, ...] = pydantic.Field(min_length=1, strict=False)
    repository: Repository
    commit: Commit
    files: tuple[RemoteFile, ...] = pydantic.Field(min_length=1, strict=False)
    image_markers_from: str | None = pydantic.Field(
        default=None, description="A model among the files whose bodies have the image's axes."
    )
    subject: Text | None = pydantic.Field(default=None, description="The subject file; none for bones alone.")
    next: tuple[Text, ...] = pydantic.Field(
        min_length=1, strict=False, description="Commands to run then; {folder} is where the files are."
    )

    @property
    def total_bytes(self) -> int:
        """Of all files."""
        return sum(file.bytes for file in self.files)

    @pydantic.model_validator(mode="after")
    def _consistent(self) -> Dataset:
        names = [file.saved_as for file in self.files]
        written = [SOURCE_FILE, SUBJECT_FILE, IMAGE_MARKERS_FILE]
        if len({*names, *written}) != len(names) + len(written):
            raise ValueError("two files have the same name")
        if self.image_markers_from is not None and self.image_markers_from not in names:
            raise ValueError(f"image_markers_from: there is no file '{self.image_markers_from}'")
        return self


class CatalogueDocument(_Strict):
    """``datasets.yaml``."""

    datasets: dict[Name, Dataset]


def read_catalogue() -> dict[str, Dataset]:
    """All datasets by name, in the catalogue's order.

    Examples
    --------
    >>> "jia_mri" in read_catalogue()
    True
    """
    return CatalogueDocument.model_validate(
        reference.read_reference(reference.find_reference_folder() / "datasets.yaml")
    ).datasets


def find_dataset(name: str, catalogue: dict[str, Dataset]) -> Dataset:
    """One dataset by name.

    Raises InputError: there is none of that name; the error lists close ones, or all.
    """
    if name in catalogue:
        return catalogue[name]
    guess = suggest_name(name.lower(), catalogue, cutoff=0.5)
    raise InputError(
        f"there is no dataset '{name}'", field="NAME", remedy=f"{guess}There are {', '.join(catalogue)}"
    )
