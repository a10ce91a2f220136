"""The names that requests and results use, as they travel."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class _Travels(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class MarkerWord(_Travels):
    """A marker of a model."""

    name: str
    segment: str = Field(description="What it sits on.")
    anatomical: bool = Field(description="Whether it is on a bony landmark.")


class CoordinateWord(_Travels):
    """A degree of freedom of a model."""

    name: str
    unit: Literal["deg", "m"]


class ModelWord(_Travels):
    """A built-in model."""

    name: str
    segments: list[str]
    markers: list[MarkerWord]
    coordinates: list[CoordinateWord]
    feet: bool = Field(description="Whether forces of the ground can act on it.")


class MethodWord(_Travels):
    """A method of scaling."""

    name: str
    meaning: str = Field(description="What is fitted, in plain words.")
    starts_from: str | None = Field(description="The method that gives the first guess.")
    needs_images: bool


class Vocabulary(_Travels):
    """Built-in models, methods and bones."""

    models: list[ModelWord]
    methods: list[MethodWord]
    bones: list[str] = Field(description="Segments of which meshes can be given.")
