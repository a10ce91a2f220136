"""The command that finds landmarks on bones."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from scaling_service.bones.whole import BONES
from scaling_service.capabilities.landmarks.document import BoneDocument, LandmarksDocument
from scaling_service.capabilities.landmarks.run import landmark_bones, save_landmarks
from scaling_service.capabilities.shared import options
from scaling_service.capabilities.shared.screen import progress_bar
from scaling_service.documents.writing import check_folder


class Units(StrEnum):
    """Length unit of the mesh files."""

    MM = "mm"
    CM = "cm"
    M = "m"
    DETECT = "detect"


def _bone(name: str, words: str) -> typer.models.OptionInfo:
    option: typer.models.OptionInfo = typer.Option(
        f"--{name}", metavar="MESH", help=words, show_default=False
    )
    return option


_MeshFile = Path | None


def landmarks(
    out: options.Out,
    pelvis: Annotated[_MeshFile, _bone("pelvis", "Both hip bones, sacrum in or out.")] = None,
    femur_r: Annotated[_MeshFile, _bone("femur_r", "Right femur.")] = None,
    tibia_r: Annotated[_MeshFile, _bone("tibia_r", "Right tibia, with its fibula if imaged.")] = None,
    talus_r: Annotated[_MeshFile, _bone("talus_r", "Right talus, for the ankle's axis.")] = None,
    femur_l: Annotated[_MeshFile, _bone("femur_l", "Left femur.")] = None,
    tibia_l: Annotated[_MeshFile, _bone("tibia_l", "Left tibia, with its fibula if imaged.")] = None,
    talus_l: Annotated[_MeshFile, _bone("talus_l", "Left talus.")] = None,
    units: Annotated[Units, typer.Option(help="Unit of all meshes.")] = Units.DETECT,
) -> None:
    """Find joint centres, axes and bony landmarks on surfaces of bones (STL, PLY, OBJ, VTP).

    Orientation and side are found from the shapes. Writes landmarks.json under --out, in mm in the
    image's own axes, each with its residual, the share of the shape that is covered, and a confidence.

    [bold]Example[/bold]: scaling-service landmarks --units mm --femur_r F.stl --tibia_r T.stl --out found
    """
    check_folder(out)
    given = dict(zip(BONES, (pelvis, femur_r, tibia_r, talus_r, femur_l, tibia_l, talus_l), strict=True))
    with progress_bar() as progress:
        document = landmark_bones(
            {name: path for name, path in given.items() if path is not None},
            units=units.value,
            progress=progress,
        )
    path = save_landmarks(document, out)
    _show(document, path)


def _show(document: LandmarksDocument, path: Path) -> None:
    """A table of what was found, then what was refused or is doubtful."""
    console = Console()
    table = Table(title=f"Landmarks, mm (files in {document.settings['units']})")
    for heading in ("bone", "landmark", "x", "y", "z"):
        table.add_column(heading, justify="left" if heading in ("bone", "landmark") else "right")
    said: list[str] = []
    for name in BONES:
        bone: BoneDocument | None = getattr(document, name)
        if bone is None:
            continue
        for field, value in bone:
            if field.endswith("_mm") and isinstance(value, tuple):
                table.add_row(name, field.removesuffix("_mm"), *(f"{x:.1f}" for x in value))
        said += [f"{name}: no {what}: {why}" for what, why in bone.refused.items()]
        said += [f"{name}: {warning}" for warning in bone.warnings]
    console.print(table)
    for line in said:
        console.print(f"[yellow]note[/yellow] {escape(line)}")
    console.print(f"Written: {escape(str(path))}")
