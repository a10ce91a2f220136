"""The command that finds landmarks on bones."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Annotated, Literal

import typer

from scaling_service.capabilities.shared import flags, screen
from scaling_service.capabilities.shared.names import BONE_NAMES
from scaling_service.core.names import say_name, spell_name
from scaling_service.report.tables import Row, Table

COMMANDS = ("landmarks",)


def _make_bone_option(name: str, words: str) -> typer.models.OptionInfo:
    option: typer.models.OptionInfo = typer.Option(
        f"--{name}", metavar="MESH", help=words, show_default=False
    )
    return option


_MeshFile = Path | None


def landmarks(
    out: flags.Out,
    pelvis: Annotated[_MeshFile, _make_bone_option("pelvis", "Both hip bones, sacrum in or out.")] = None,
    femur_r: Annotated[_MeshFile, _make_bone_option("femur_r", "Right femur.")] = None,
    tibia_r: Annotated[
        _MeshFile, _make_bone_option("tibia_r", "Right tibia, with its fibula if imaged.")
    ] = None,
    talus_r: Annotated[_MeshFile, _make_bone_option("talus_r", "Right talus, for the ankle's axis.")] = None,
    femur_l: Annotated[_MeshFile, _make_bone_option("femur_l", "Left femur.")] = None,
    tibia_l: Annotated[
        _MeshFile, _make_bone_option("tibia_l", "Left tibia, with its fibula if imaged.")
    ] = None,
    talus_l: Annotated[_MeshFile, _make_bone_option("talus_l", "Left talus.")] = None,
    segmentation: Annotated[
        Path | None,
        typer.Argument(
            metavar="[SEGMENTATION]",
            help="A label map (.nii, .nii.gz), or a folder of one mask or surface a label.",
            show_default=False,
        ),
    ] = None,
    units: Annotated[Literal["mm", "cm", "m", "detect"], typer.Option(help="Unit of all meshes.")] = "detect",
    tables: flags.Tables = "",
) -> None:
    """Find joint centres, axes and bony landmarks on surfaces of bones or in a segmentation.

    Surfaces are STL, PLY, OBJ or VTP. Orientation and side are found from the shapes. Writes landmarks.json
    under --out, in mm in the image's own axes, each with its residual, the share of the shape that is
    covered, and a deviation.

    A segmentation's labels may be called as TotalSegmentator, 3D Slicer and others do (hip_left, sacrum,
    femur_right, tibia); a table beside a label map with the same stem (.json, .txt, .ctbl) names its numbers.

    [bold]Example[/bold]: scaling-service landmarks --units mm --femur_r F.stl --tibia_r T.stl --out found
    """
    meshes = (pelvis, femur_r, tibia_r, talus_r, femur_l, tibia_l, talus_l)
    given = {name: path for name, path in zip(BONE_NAMES, meshes, strict=True) if path is not None}
    if segmentation is not None:
        given["segmentation"] = segmentation
    with screen.running(out) as progress:
        from scaling_service.capabilities.landmarks.result import tabulate_points
        from scaling_service.capabilities.landmarks.run import landmark_bones, save_landmarks
        from scaling_service.capabilities.shared.tables import make_table_writer

        write_tables = make_table_writer(tables, out)
        document = landmark_bones(given, units=units, progress=progress)
        path = save_landmarks(document, out)
        table = tabulate_points(document)
        write_tables({"landmarks": table}, document)
    # A table of what was found, then what was refused or is doubtful
    rows: list[Row] = []
    notes = list(document.warnings)
    for bone, points in groupby(table.rows, key=lambda row: row[0]):
        rows.append(Row(spell_name(bone)))
        rows += [
            Row(f"  {spell_name(point)}", [f"{value:.1f}" for value in values])
            for _, point, *values in points
        ]
    for name, found in document.bones.items():
        notes += [f"{say_name(name)}: no {say_name(what)}: {why}" for what, why in found.refused.items()]
        notes += [f"{say_name(name)}: {warning}" for warning in found.warnings]
    console = screen.make_console()
    caption = f"Landmarks, mm (files in {document.settings['units']})"
    screen.print_table(console, Table(caption=caption, columns=["", "x", "y", "z", "±"], rows=rows))
    screen.say(console, "Note", "yellow", notes)
    screen.list_files(console, out, [path.name])
