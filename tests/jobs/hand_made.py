"""Findings made by hand: what a document makes of them can be reckoned on paper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scaling_service.capabilities.discovery.evidence.statistics import NOTHING, HeldOut
from scaling_service.capabilities.discovery.laws.candidates import (
    Candidate,
    Column,
    Contact,
    Estimate,
    FreeMotion,
)
from scaling_service.capabilities.discovery.laws.loads import Inertial
from scaling_service.capabilities.discovery.search.findings import Findings, Gap, Level, NamedEffect

UNSEEN = HeldOut(0.5, 1e-4, False)


def named(candidate: Candidate, size: list[float], sd: list[float]) -> NamedEffect:
    """An effect of known size and spread, the numbers independent."""
    covariance = np.diag(np.square(sd))
    effect = Estimate(candidate, np.array(size))
    return NamedEffect(effect, covariance, NOTHING, 0.01, UNSEEN)


LOAD = named(
    Candidate(
        "carried_load",
        ("torso",),
        tuple(
            Column(name, unit, load=Inertial("torso", tuple(np.eye(10)[k].tolist())))
            for k, (name, unit) in enumerate((("kg", 1.0), ("x_kgmm", 1e3), ("y_kgmm", 1e3), ("z_kgmm", 1e3)))
        ),
    ),
    [2.0, 0.1, 0.4, 0.0],
    [0.1, 0.02, 0.02, 0.02],
)
"""2 kg at (50, 200, 0) mm."""

SCALE = named(
    Candidate("capture_scale", ("markers",), (Column("factor", 1.0, neutral=1.0),)), [0.01], [0.001]
)
"""One per cent too large."""

LOCKED = replace(
    named(
        Candidate(
            "missing_dof",
            ("knee_r",),
            (),
            note="extra turn",
            change=FreeMotion("tibia_r", "before", "rotation", (0.0, 1.0, 0.0)),
        ),
        [],
        [],
    ),
    details={"rms_deg": 4.0, "axis_x": 0.0, "axis_y": 1.0, "axis_z": 0.0},
    smallest={"rms_deg": float("nan")},
)

TOUCH = replace(
    named(
        Candidate(
            "external_contact",
            ("torso",),
            (),
            trials=("squat",),
            change=Contact("torso", 0.5, 1.5, (0.05, 0.3, 0.0)),
        ),
        [],
        [],
    ),
    details={"start_s": 0.5, "end_s": 1.5, "rms_N": 40.0},
    spreads={"start_s": 0.05, "rms_N": 2.0},
)


def findings(*effects: NamedEffect) -> Findings:
    """With a gap whose numbers are round, and a ceiling that is not known."""
    level = Level(0.010, 0.002, 0.001, float("nan"), 0.0015, 0.0025)
    force = Level(20.0, 5.0, 4.0, 10.0, 4.5, 5.5)
    gap = Gap(
        {"whitened": Level(10.0, 2.0, 1.0, 5.0, 1.5, 2.5), "markers": level, "force": force},
        {"RLFE": level, "fx": force, "mx": Level(3.0, 1.0, 0.5, float("nan"), 0.9, 1.1)},
        float("nan"),
    )
    return Findings("found", (), effects, gap, gap, False, (), (), "enough", ("a note",))
