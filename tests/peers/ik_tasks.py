"""Weights of an OpenSim inverse kinematics set-up, for comparisons with its own tool."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree


def read_ik_tasks(path: Path) -> tuple[dict[str, float], dict[str, float]]:
    """Marker and coordinate weights of the tasks that apply; a set in a file of its own is followed."""
    root = ElementTree.parse(path).getroot()
    tasks = next(e for e in root.iter() if e.tag == "IKTaskSet")
    if tasks.get("file"):
        root = ElementTree.parse(path.parent / str(tasks.get("file"))).getroot()
        tasks = next(e for e in root.iter() if e.tag == "IKTaskSet")
    found: dict[str, dict[str, float]] = {"IKMarkerTask": {}, "IKCoordinateTask": {}}
    for task in tasks.iter():
        if task.tag in found and (task.findtext("apply") or "true").strip().lower() in {"true", "1"}:
            found[task.tag][str(task.get("name"))] = float(task.findtext("weight") or 1.0)
    return found["IKMarkerTask"], found["IKCoordinateTask"]
