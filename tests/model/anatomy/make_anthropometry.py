"""Writes ``reference_models/anthropometry_ansur2.yaml`` from the public files of ANSUR II.

``python -m tests.model.anatomy.make_anthropometry FOLDER``, with the survey's two files in the folder.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scaling_service.model.reference import find_reference_folder

COLUMNS = {
    "stature": "stature",
    "mass": "weightkg",
    "trochanterion_height": "trochanterionheight",
    "lateral_epicondyle_height": "lateralfemoralepicondyleheight",
    "lateral_malleolus_height": "lateralmalleolusheight",
    "tibiale_height": "tibialheight",
    "sitting_knee_height": "kneeheightsitting",
    "functional_leg_length": "functionalleglength",
    "iliocristale_height": "iliocristaleheight",
    "sitting_height": "sittingheight",
    "cervicale_height": "cervicaleheight",
    "suprasternale_height": "suprasternaleheight",
    "acromion_height": "acromialheight",
    "biacromial_breadth": "biacromialbreadth",
    "acromion_radiale": "acromionradialelength",
    "radiale_stylion": "radialestylionlength",
    "hand_length": "handlength",
    "foot_length": "footlength",
    "bimalleolar_breadth": "bimalleolarbreadth",
    "bicristal_breadth": "bicristalbreadth",
    "hip_breadth": "hipbreadth",
    "head_length": "headlength",
    "head_breadth": "headbreadth",
}
"""Our names of ANSUR II's columns."""

FILES = {"F": "ANSUR_II_FEMALE_Public.csv", "M": "ANSUR_II_MALE_Public.csv"}

HEADER = """\
# Logarithms of body measures (m; mass in kg) of the soldiers of ANSUR II: mean, SD and correlation by sex.
# Source: Gordon et al. 2014, 2012 Anthropometric Survey of U.S. Army Personnel, NATICK/TR-15/007.
# Written by tests/model/anatomy/make_anthropometry.py. Correlations: rows of the lower triangle, no diagonal.
"""


def read_logs(folder: Path, sex: str) -> NDArray[np.float64]:
    """Logarithms of the measures, shape (n_persons, n_measures): m, and kg for mass."""
    with (folder / FILES[sex]).open(encoding="latin-1", newline="") as file:
        rows = [[float(row[column]) for column in COLUMNS.values()] for row in csv.DictReader(file)]
    units = np.where(np.array(list(COLUMNS)) == "mass", 0.1, 0.001)  # files: mm and 0.1 kg
    return np.log(np.array(rows) * units)


def write_document(folder: Path) -> str:
    """The YAML document of the statistics."""
    lines = [HEADER.rstrip(), f"names: [{', '.join(COLUMNS)}]"]
    for sex in FILES:
        logs = read_logs(folder, sex)
        correlation = np.corrcoef(logs, rowvar=False)
        lines += [
            f"{sex}:",
            f"  persons: {len(logs)}",
            f"  mean: {_row(logs.mean(axis=0), 5)}",
            f"  spread: {_row(logs.std(axis=0, ddof=1), 5)}",
            "  correlation:",
        ]
        lines += [f"    - {_row(correlation[i, :i], 4)}" for i in range(1, len(correlation))]
    return "\n".join(lines) + "\n"


def _row(values: NDArray[np.float64], digits: int) -> str:
    return "[" + ", ".join(f"{value:.{digits}f}" for value in values) + "]"


if __name__ == "__main__":
    target = find_reference_folder() / "anthropometry_ansur2.yaml"
    Path(str(target)).write_text(write_document(Path(sys.argv[1])), encoding="utf-8")
