"""Legs as an OpenSim user has them: the generic model with every marker, and a set-up of the scale tool."""

from __future__ import annotations

import json
from collections import abc
from pathlib import Path
from typing import Any

from scaling_service.files.osim.models import write_osim
from scaling_service.files.trc import write_trc
from scaling_service.model.body import Marker
from scaling_service.model.builtin import load_builtin
from scaling_service.model.trial import Trial
from scaling_service.studies.benchmark import parts

GENERIC = "lower_limb_14dof"

_ROUGHLY = {
    "femur": [(0.08, -0.18, 0.02), (0.04, -0.22, 0.07), (0.05, -0.28, 0.06), (0.0, -0.25, 0.08)],
    "tibia": [(0.05, -0.12, 0.02), (0.03, -0.18, 0.04), (0.04, -0.25, 0.03), (0.0, -0.22, 0.05)],
}
"""Where markers of clusters are put on the generic model, m, right side; the scale tool's marker placer moves
them to where they were in the standing trial."""

_MEASUREMENTS: abc.Mapping[str, tuple[tuple[str, str], ...]] = {
    "pelvis": (("RASIS", "LASIS"),),
    "femur_r femur_l": (("RASIS", "RLFE"), ("LASIS", "LLFE")),
    "tibia_r tibia_l": (("RLFE", "RLM"), ("LLFE", "LLM")),
}
"""As OpenSim's own example for gait2354 measures pelvis, thigh and shank (subject01_Setup_Scale.xml)."""


def write_legs(folder: Path, trials: abc.Iterable[Trial], clusters: abc.Mapping[str, str]) -> None:
    """Write ``generic.osim``, ``setup_scale.xml`` and every trial as TRC; the one named static is standing.

    ``clusters``: markers that the generic model lacks, and the segment each is on.
    """
    model = load_builtin(GENERIC)
    taken = dict.fromkeys(model.segment_names, 0)
    more = []
    for name, segment in clusters.items():
        x, y, z = _ROUGHLY[segment[:-2]][taken[segment] % 4]
        taken[segment] += 1
        more.append(Marker.at(name, segment, (x, y, z if segment.endswith("_r") else -z)))
    model = model.with_markers((*model.markers, *more))
    folder.mkdir(parents=True, exist_ok=True)
    write_osim(folder / "generic.osim", model)
    last = 0.0
    for trial in trials:
        write_trc(folder / f"{trial.name}.trc", trial)
        last = float(trial.times[-1]) if trial.name == "static" else last
    (folder / "setup_scale.xml").write_text(_write_setup([m.name for m in model.markers], last), "utf-8")


def write_subject(folder: Path, document: abc.Mapping[str, Any]) -> Path:
    """Write a subject file for our program (JSON is YAML, too)."""
    path = folder / "subject.yaml"
    path.write_text(json.dumps(document, indent=1), encoding="utf-8")
    return path


def _write_setup(markers: list[str], last_s: float) -> str:
    """A set-up of OpenSim's scale tool: measurements, then all markers moved to the standing pose."""
    measurements = "".join(
        f'<Measurement name="{bodies.split("_")[0]}"><apply>true</apply><MarkerPairSet><objects>'
        + "".join(f"<MarkerPair><markers>{a} {b}</markers></MarkerPair>" for a, b in pairs)
        + "</objects></MarkerPairSet><BodyScaleSet><objects>"
        + "".join(f'<BodyScale name="{body}"><axes>X Y Z</axes></BodyScale>' for body in bodies.split())
        + "</objects></BodyScaleSet></Measurement>"
        for bodies, pairs in _MEASUREMENTS.items()
    )
    tasks = "".join(
        f'<IKMarkerTask name="{name}"><apply>true</apply><weight>1</weight></IKMarkerTask>'
        for name in markers
    )
    span = f"<time_range>0 {last_s:.6f}</time_range>"
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<OpenSimDocument Version="40000"><ScaleTool name="person">'
        "<mass>-1</mass><GenericModelMaker><model_file>generic.osim</model_file></GenericModelMaker>"
        "<ModelScaler><apply>true</apply><scaling_order>measurements</scaling_order>"
        f"<MeasurementSet><objects>{measurements}</objects></MeasurementSet>"
        f"<marker_file>static.trc</marker_file>{span}"
        "<preserve_mass_distribution>false</preserve_mass_distribution></ModelScaler>"
        f"<MarkerPlacer><apply>true</apply><IKTaskSet><objects>{tasks}</objects></IKTaskSet>"
        f"<marker_file>static.trc</marker_file>{span}</MarkerPlacer></ScaleTool></OpenSimDocument>\n"
    )


def scale_by_ours(method: str, folder: Path, moving: str, answer: Path, run: parts.Run) -> None:
    """Our model, and the motion that the model, used again, has in a recording, with its deviations."""
    result = run(["scale", folder / "subject.yaml", "--method", method]) / method
    followed = run(["ik", result / "model.json", folder / f"{moving}.trc"])
    (result / "model.osim").replace(answer / "model.osim")
    (followed / f"{moving}_ik.mot").replace(answer / f"{moving}.mot")
    (followed / f"{moving}_ik_sd.mot").replace(answer / f"{moving}_sd.mot")


def scale_by_opensim(folder: Path, moving: str, answer: Path, _run: parts.Run) -> None:
    """What the scale tool and then the inverse kinematics tool make of it."""
    model = answer / "model.osim"
    parts.ask_opensim(
        "scale",
        folder / "setup_scale.xml",
        model=folder / "generic.osim",
        static=folder / "static.trc",
        output=model,
    )
    parts.ask_opensim("track", model, recording=folder / f"{moving}.trc", output=answer / f"{moving}.mot")
