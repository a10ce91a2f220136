"""Findings made by hand: what a document makes of them can be reckoned on paper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scaling_service.capabilities.discovery.laws.candidates import (
    Candidate,
    Column,
    Contact,
    Estimate,
    FreeMotion,
)
from scaling_service.capabilities.discovery.laws.loads import Inertial
from scaling_service.capabilities.discovery.ordinary.forces import NOISE
from scaling_service.capabilities.discovery.result import (
    DiscoverResults,
    GapDocument,
    LevelDocument,
    PlaceLevelDocument,
    Unit,
)
from scaling_service.capabilities.discovery.search.discover import Discovery
from scaling_service.capabilities.discovery.search.findings import NamedEffect


def named(candidate: Candidate, size: list[float], sd: list[float]) -> NamedEffect:
    """An effect of known size and spread, the numbers independent."""
    covariance = np.diag(np.square(sd))
    effect = Estimate(candidate, np.array(size))
    return NamedEffect(effect=effect, covariance=covariance, odds=4.6, gain=0.5)


LOAD = named(
    Candidate(
        kind="carried_load",
        where=("torso",),
        columns=tuple(
            Column(name=name, unit=unit, load=Inertial("torso", tuple(np.eye(10)[k].tolist())))
            for k, (name, unit) in enumerate((("kg", 1.0), ("x_kgmm", 1e3), ("y_kgmm", 1e3), ("z_kgmm", 1e3)))
        ),
    ),
    [2.0, 0.1, 0.4, 0.0],
    [0.1, 0.02, 0.02, 0.02],
)
"""2 kg at (50, 200, 0) mm."""

SCALE = named(
    Candidate(
        kind="capture_scale", where=("markers",), columns=(Column(name="factor", unit=1.0, neutral=1.0),)
    ),
    [0.01],
    [0.001],
)
"""One per cent too large."""

LOCKED = replace(
    named(
        Candidate(
            kind="missing_dof",
            where=("knee_r",),
            columns=(),
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
            kind="external_contact",
            where=("torso",),
            columns=(),
            trials=("squat",),
            change=Contact(
                segment="torso", start_s=0.5, end_s=1.5, point=(0.05, 0.3, 0.0), noise=tuple(NOISE)
            ),
        ),
        [],
        [],
    ),
    details={"start_s": 0.5, "end_s": 1.5, "rms_N": 40.0},
    spreads={"start_s": 0.05, "rms_N": 2.0},
)


def search(found: DiscoverResults, *effects: NamedEffect) -> Discovery:
    """Of the same recordings, with a gap whose numbers are round, and a ceiling that is not known."""
    level = LevelDocument(before=10.0, after=2.0, floor=1.0, ceiling=None, low=1.5, high=2.5)
    force = LevelDocument(before=20.0, after=5.0, floor=4.0, ceiling=10.0, low=4.5, high=5.5)
    moment = LevelDocument(before=3.0, after=1.0, floor=0.5, ceiling=None, low=0.9, high=1.1)
    units: dict[str, tuple[LevelDocument, Unit]] = {
        "RLFE": (level, "mm"),
        "fx": (force, "N"),
        "mx": (moment, "N m"),
    }
    gap = GapDocument(
        whitened=level.model_copy(update={"ceiling": 5.0}),
        markers_mm=level,
        force_N=force,
        moment_Nm=None,
        places={name: PlaceLevelDocument(**dict(own), unit=unit) for name, (own, unit) in units.items()},
    )
    return Discovery(
        disagreements=(),
        named=effects,
        fit=gap,
        held_out=gap,
        tried=(),
        unexplained=(),
        reason="enough",
        notes=("a note",),
        before=found.before,
        after=found.after,
    )
