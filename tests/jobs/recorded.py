"""Subject documents of persons who were really recorded; files by their absolute paths."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def walker_document(data: Path) -> dict[str, Any]:
    """A person who walks, in C3D files with another laboratory's names, for a built-in model."""
    folder = data / "jia_mri"
    return {
        "subject": {"id": "walker", "height_m": 1.62, "mass_kg": 63.0},
        "model": "lower_limb_14dof",
        "extra_markers": {"RTHI": "femur_r", "RTUB": "tibia_r", "LTHI": "femur_l", "LTUB": "tibia_l"},
        "trials": {
            "static": str(folder / "Static.c3d"),
            "calibration": [str(folder / "Walking02.c3d")],
            "evaluation": [str(folder / "Walking01.c3d")],
        },
    }


def imaged_walker_document(data: Path) -> dict[str, Any]:
    """The same person for Rajagopal's model, with bones of the right leg."""
    bones = data / "jia_mri" / "bones"
    return walker_document(data) | {
        "model": str(data / "rajagopal_walk" / "Rajagopal2016.osim"),
        "extra_markers": {},
        "bones": {
            "units": "mm",
            "pelvis": str(bones / "pelvis_no_sacrum.stl"),
            "femur_r": str(bones / "femur_r.stl"),
            "tibia_r": str(bones / "tibia_r.stl"),
        },
        "image_markers": str(data / "jia_mri" / "image_markers.csv"),
    }


def squatter_document(data: Path) -> dict[str, Any]:
    """A person who squats, in TRC files, for an OpenSim model of the whole body."""
    folder = data / "opencap_squat"
    return {
        "subject": {"id": "squatter", "height_m": 1.68, "mass_kg": 62.6},
        "model": str(folder / "unscaled_generic.osim"),
        "trials": {
            "static": str(folder / "static1.trc"),
            "calibration": [str(folder / "squats1.trc")],
            "evaluation": [str(folder / "walking1.trc")],
        },
        "forces": {"squats1.trc": str(folder / "squats1_grf.mot")},
    }
