"""Derives ``reference_models/skin_over_knee.yaml`` from markers over bones of known pose.

``python -m tests.living_bone.skin_over_knee`` writes it anew.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from scaling_service.files.osim.models import read_osim
from scaling_service.model.anatomy.lengths import find_joint_ends
from scaling_service.model.anatomy.skin import is_pin
from scaling_service.model.people import read_people
from scaling_service.numerics.multibody.laws import Array
from tests.living_bone.recordings import SETS, BoneSet, measure_joint_angles, read_bones, read_skin

FILE = Path(__file__).resolve().parents[2] / "reference_models" / "skin_over_knee.yaml"

_FEWEST = 5  # frames
_LEAST_FLEXION = np.radians(3.0)  # standard deviation; a knee that hardly flexes tells nothing

HEAD = """\
# How skin slides over thigh and shank as the knee flexes, where laboratories saw bones and markers at once.
# Derived from markers in their bones' axes by `python -m tests.living_bone.skin_over_knee`: each marker's
# mean place from the knee's centre (forward, up, outward; mm), the slope of its displacement on flexion (mm
# per rad), and the slope's standard deviation from what else the skin of that movement did (mm per rad; skin
# is seen anew after twice its time of correlation).
# source: Cereatti et al. 2017, J Biomech 62:5-13, doi 10.1016/j.jbiomech.2017.02.004, and the studies named
# there. confidence: high for each person, low for people at large: four persons of three laboratories.
"""


def derive_rows(root: Path, measured: BoneSet, bone: str) -> list[Array]:
    """Seven numbers of each marker on a bone, mm and mm per rad; empty where the knee does not flex."""
    folder = root / measured.name
    model = read_osim(folder / "model.osim")
    if not {"femur", "tibia"} <= set(model.segment_names):
        return []
    flip = np.array([1.0, 1.0, measured.side])
    centre = find_joint_ends(model, "knee", "")[bone]
    markers = [m.name for m in model.markers if m.segment == bone and not is_pin(m.name)]
    if not markers:
        return []
    flexions, places = _read_movements(folder, markers, together=measured.sound)
    rows = []
    for k in range(len(markers)):
        bent, moved, at = [], [], []
        for flexion, place in zip(flexions, places, strict=True):
            known = np.isfinite(flexion) & np.isfinite(place[:, k]).all(axis=1)
            if known.sum() >= _FEWEST:
                bent.append(flexion[known] - flexion[known].mean())
                moved.append(place[known, k] - place[known, k].mean(axis=0))
                at.append(place[known, k].mean(axis=0))
        if not bent:
            continue
        x, y = np.concatenate(bent), np.concatenate(moved)
        if x.std() < _LEAST_FLEXION:
            continue
        slope = x @ y / (x @ x)
        seen = max(len(x) / measured.rate_hz / (2.0 * read_people().loose_s), 2.0)
        noise = np.sqrt(np.square(y - x[:, None] * slope).mean()) / (x.std() * np.sqrt(seen))
        rows.append(1e3 * np.concatenate([flip * (np.mean(at, axis=0) - centre), flip * slope, [noise]]))
    return rows


def _read_movements(folder: Path, markers: list[str], *, together: bool) -> tuple[list[Array], list[Array]]:
    """Flexion (n,), rad, and places (n, m, 3), m; of all recordings, or of each where they do not compare."""
    flexions, places = [], []
    for path in sorted(folder.glob("*_bones.csv")):
        angles = measure_joint_angles({b: r for b, r in read_bones(path).items() if b in ("femur", "tibia")})
        skin = read_skin(path.with_name(path.name.replace("_bones", "_skin")))
        n = min(len(angles), *(len(skin[m]) for m in markers))
        flexions.append(-angles[:n, 0])
        places.append(np.stack([skin[m][:n] for m in markers], axis=1))
    return ([np.concatenate(flexions)], [np.concatenate(places)]) if together else (flexions, places)


def list_lines(root: Path) -> Iterator[str]:
    """The lines of the file below its head."""
    yield "movements:"
    for measured in SETS:
        parts = {
            part: derive_rows(root, measured, bone) for part, bone in (("thigh", "femur"), ("shank", "tibia"))
        }
        if not any(parts.values()):
            continue
        yield f"  - laboratory: {measured.laboratory}"
        yield f"    person: {measured.person}"
        yield f"    movement: {measured.name}"
        for part, rows in parts.items():
            yield f"    {part}:"
            for row in rows:
                numbers = [*(f"{v:.0f}" for v in row[:3]), *(f"{v:.1f}" for v in row[3:])]
                yield f"      - [{', '.join(numbers)}]"


if __name__ == "__main__":
    data = Path(os.environ.get("SCALING_SERVICE_DATA", FILE.parents[2] / "shared" / "data"))
    FILE.write_text(HEAD + "\n".join(list_lines(data / "living_bone")) + "\n", encoding="utf-8")
