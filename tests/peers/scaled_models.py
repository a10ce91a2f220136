"""OpenSim's published models scaled to the persons of its published recordings, by its own ScaleTool."""

from __future__ import annotations

from pathlib import Path

from tests.peers.opensim_scale import run_opensim_scale


def scaled_gait2354(data: Path, folder: Path) -> Path:
    """The model of ``subject01``, written to the folder."""
    gait, model = data / "gait2354", folder / "gait2354.osim"
    run_opensim_scale(
        gait / "subject01_Setup_Scale.xml",
        gait / "gait2354_simbody.osim",
        gait / "subject01_static.trc",
        marker_set=gait / "gait2354_Scale_MarkerSet.xml",
        output=model,
    )
    return model


def scaled_rajagopal(data: Path, folder: Path) -> Path:
    """The model of the walker, written to the folder: sizes first, then markers from another pose."""
    walk, sizes, model = data / "rajagopal_walk", folder / "sizes.osim", folder / "rajagopal.osim"
    run_opensim_scale(
        walk / "scale_setup_walk_scaleOnly.xml",
        walk / "Rajagopal2016.osim",
        walk / "static_walk_1.trc",
        marker_set=walk / "markerset_walk_preScale.xml",
        output=sizes,
    )
    run_opensim_scale(walk / "scale_setup_walk.xml", sizes, walk / "static_walk_2.trc", output=model)
    return model
