"""The table of cases: which commands run, on whom, and whether they are dear."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

DATA = "{data}"
"""Stands for the folder of the real recordings, in arguments and documents."""


@dataclass(frozen=True)
class Case:
    """Command lines that run one after another in one folder.

    ``subject`` names a folder packed under ``subjects/``; ``documents`` are further files to write there.
    ``costly`` cases run only when asked for. Those that mention ``DATA`` skip where there are no recordings.
    """

    name: str
    commands: tuple[str, ...]
    subject: str | None = None
    documents: Mapping[str, str] = field(default_factory=dict)
    costly: bool = False

    @property
    def needs_data(self) -> bool:
        return any(DATA in text for text in (*self.commands, *self.documents.values()))


_WALKER = """
subject: {id: walker, height_m: 1.62, mass_kg: 63.0}
model: lower_limb_14dof
extra_markers: {RTHI: femur_r, RTUB: tibia_r, LTHI: femur_l, LTUB: tibia_l}
trials:
  static: {data}/jia_mri/Static.c3d
  calibration: ["{data}/jia_mri/Walking02.c3d"]
  evaluation: ["{data}/jia_mri/Walking01.c3d"]
"""

_SQUATTER = """
subject: {id: squatter, sex: M, height_m: 1.68, mass_kg: 62.6}
model: {model}
trials:
  static: {data}/opencap_squat/static1.trc
  calibration: ["{data}/opencap_squat/squats1.trc"]
  evaluation: ["{data}/opencap_squat/walking1.trc"]
forces:
  squats1.trc: {data}/opencap_squat/squats1_grf.mot
  walking1.trc: {data}/opencap_squat/walking1_grf.mot
"""

_OSIM_SQUATTER = _SQUATTER.replace("sex: M, ", "").replace(
    "{model}", "{data}/opencap_squat/unscaled_generic.osim"
)
_FULL_SQUATTER = _SQUATTER.replace("{model}", "full_body_35dof")

CASES = (
    Case(
        "demo",
        (
            "demo --out demo",
            "landmarks --units m --pelvis demo/EB/bones/pelvis.stl --femur_r demo/EB/bones/femur_r.stl"
            " --tibia_r demo/EB/bones/tibia_r.stl --femur_l demo/EB/bones/femur_l.stl --out landmarks",
        ),
    ),
    Case(
        "compare",
        (
            "compare S01.yaml --out compare",
            "ik compare/MB_am/model.json recordings/walk.trc recordings/hips.trc --poses --out ik",
        ),
        subject="leg",
    ),
    Case("proof", ("proof recordings --out proof",), subject="leg"),
    Case("scale", ("scale S01.yaml --method MB_am --frames 60 --out scale",), subject="leg"),
    Case(
        "scale_otherwise",
        (
            "scale S02.yaml --method MB_lam --strategy alternating --smooth-hz 8 --sizes measured"
            " --knee universal --scaling per-axis --hip-regression hara2016 --out scale",
        ),
        subject="leg",
    ),
    Case(
        "batch", ("batch cohort.csv --methods MB,MB_lam --frames 40 --workers 1 --out batch",), subject="leg"
    ),
    Case(
        "dynamics",
        ("dynamics S01.yaml --start none --identify --despite-verdict --free-mass --out dynamics",),
        subject="forces",
    ),
    Case("consistent", ("consistent S01.yaml --start none --out consistent",), subject="forces"),
    Case("discover", ("discover S02.yaml --out discover",), subject="hidden"),
    Case("demo_discover", ("demo --discover --out demo",), costly=True),
    Case("dynamics_scaled", ("dynamics S01.yaml --start MB --out dynamics",), "forces"),
    Case("discover_forces", ("discover S01.yaml --start none --out discover",), "forces", costly=True),
    Case(
        "puchaud2019",
        ("reproduce puchaud2019 --subjects 7 --frames 20 --workers 2 --out study",),
        costly=True,
    ),
    Case(
        "muller2017", ("reproduce muller2017 --subjects 1 --samples 4 --workers 1 --out study",), costly=True
    ),
    Case("futamure", ("reproduce futamure --subjects 1 --workers 1 --out study",), costly=True),
    Case("walker", ("compare S.yaml --out compare",), documents={"S.yaml": _WALKER}, costly=True),
    Case(
        "clinic",
        (f"proof {DATA}/clinic/HC030A --out proof", "scale proof/subject.yaml --method MB_lam --out scale"),
        costly=True,
    ),
    Case(
        "squatter_osim",
        ("scale S.yaml --method MB_am --out scale",),
        documents={"S.yaml": _OSIM_SQUATTER},
        costly=True,
    ),
    Case(
        "squatter_forces",
        ("dynamics S.yaml --out dynamics", "consistent S.yaml --out consistent"),
        documents={"S.yaml": _FULL_SQUATTER},
        costly=True,
    ),
    Case("hidden_case", (f"discover {DATA}/hidden/case_01/subject.yaml --out discover",), costly=True),
)

BY_NAME = {case.name: case for case in CASES}
