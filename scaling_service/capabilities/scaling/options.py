"""What can be chosen for scaling and for a comparison of methods."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from scaling_service.capabilities.shared.flags import read_names
from scaling_service.core import options


class ScaleOptions(options.Options):
    """What is written beside each method's model."""

    export: Annotated[
        tuple[Literal["mjcf", "biomod"], ...],
        options.Flag(metavar="FORMAT,…", kind=str | None, read=read_names),
    ] = Field(
        default=(),
        description="Further forms of each model, with markers and inertia: mjcf (MuJoCo; with muscles, held "
        "against OpenSim's, if it is an .osim model), biomod (biorbd; muscles as far as it has their kind).",
    )
    muscle_points: Annotated[Literal["scaled", "surface"], options.Flag(name="--muscle-points")] = Field(
        default="scaled",
        description="Where muscles are attached in the image-based methods' .osim models: scaled with their "
        "segments, or moved with the surface from the model's own bone (whose geometry file lies beside the "
        "model) to the person's.",
    )
    muscle_parameters: Annotated[Literal["ratio", "range"], options.Flag(name="--muscle-parameters")] = Field(
        default="ratio",
        description="Optimal fibre and tendon slack lengths in .osim models: both grow as the muscle does "
        "(ratio: OpenSim's scaling), or fibres work where they do in the generic model (range: Modenese et "
        "al. 2016, with rigid tendons).",
    )


class ComparisonOptions(ScaleOptions):
    """What is compared beside models, motions and errors."""

    muscles: Annotated[bool, options.Flag(name="--muscles")] = Field(
        default=False,
        description="Whether to compare what the methods make of the muscles: lengths and moment arms by "
        "OpenSim, and joint moments where there are forces. For .osim models.",
    )
