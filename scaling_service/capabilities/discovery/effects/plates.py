"""Force plates that lie, turn, measure or keep time otherwise than the recording says; a leaning vertical."""

from __future__ import annotations

import math
from collections.abc import Iterator

from scaling_service.capabilities.discovery.effects._columns import DEG, MM
from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column
from scaling_service.capabilities.discovery.laws.loads import (
    Late,
    PlateBias,
    PlateGain,
    PlateShift,
    PlateTurn,
    Tilt,
)
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.laws.spots import LETTERS
from scaling_service.core.arrays import Array

_BIASES = ("fx_N", "fy_N", "fz_N")

_LEAST_TURN = math.radians(1.0)  # chosen: plates are laid and surveyed to less


def propose_plate_biases(scene: Scene) -> Iterator[Candidate]:
    """Every plate, of its forces, in all recordings and in each."""
    for plate in scene.plates:
        columns = tuple(
            Column(name=name, unit=1.0, load=PlateBias(plate, k)) for k, name in enumerate(_BIASES)
        )
        for trials in scene.scopes_with_forces:
            yield Candidate(kind="plate_bias", where=(plate,), columns=columns, trials=trials)


def propose_plate_gains(scene: Scene) -> Iterator[Candidate]:
    """Every loaded plate, in all recordings and in each."""
    for plate in scene.plates:
        column = Column(name="factor", unit=1.0, neutral=1.0, load=PlateGain(plate))
        for trials in scene.scopes_with_forces:
            yield Candidate(kind="plate_gain", where=(plate,), columns=(column,), trials=trials)


def propose_plate_positions(scene: Scene) -> Iterator[Candidate]:
    """Every loaded plate, in all recordings and in each."""
    for plate in scene.plates:
        columns = tuple(Column(name=f"{LETTERS[k]}_mm", unit=MM, load=PlateShift(plate, k)) for k in range(3))
        for trials in scene.scopes_with_forces:
            yield Candidate(kind="plate_position", where=(plate,), columns=columns, trials=trials)


def propose_plate_rotations(scene: Scene) -> Iterator[Candidate]:
    """Every loaded plate, about the vertical and leaning, in all recordings and in each.

    Readings without the plate's place do not tell about which point it is turned: about the vertical one is
    tried, too, that also shifts, the shift being that of the ground's origin.
    """
    for plate in scene.plates:
        vertical = (Column(name="about_vertical_deg", unit=DEG, load=PlateTurn(plate, 1)),)
        elsewhere = (
            Column(
                name="about_vertical_deg",
                unit=DEG,
                load=PlateTurn(plate, 1, "ground"),
            ),
            # without bounds: far from the ground's origin a small turn goes with a large shift there
            *(Column(name=f"{LETTERS[k]}_mm", unit=MM, load=PlateShift(plate, k)) for k in (0, 2)),
        )
        leaning = tuple(
            Column(name=f"tilt_{letter}_deg", unit=DEG, load=PlateTurn(plate, k))
            for k, letter in ((0, "x"), (2, "z"))
        )
        for trials in scene.scopes_with_forces:
            yield Candidate(kind="plate_rotation", where=(plate,), columns=vertical, trials=trials)
            yield Candidate(
                kind="plate_rotation",
                where=(plate,),
                columns=elsewhere,
                trials=trials,
                note="about another point",
                together=_is_turn_alone,
            )
            yield Candidate(
                kind="plate_rotation", where=(plate,), columns=leaning, trials=trials, note="leaning"
            )


def _is_turn_alone(size: Array) -> bool:
    """Whether a turn with a shift is more than a shift."""
    return bool(abs(size[0]) >= _LEAST_TURN)


def propose_force_delays(scene: Scene) -> Iterator[Candidate]:
    """All recordings with forces, and each by itself."""
    if scene.plates:
        columns = (Column(name="delay_s", unit=1.0, load=Late()),)
        for trials in scene.scopes_with_forces:
            yield Candidate(kind="force_delay", where=("forces",), columns=columns, trials=trials)


def propose_gravity_tilt(scene: Scene) -> Iterator[Candidate]:
    """The whole world, about its two level axes."""
    if scene.plates:
        columns = tuple(Column(name=name, unit=DEG, load=Tilt(k)) for k, name in ((0, "x_deg"), (2, "z_deg")))
        yield Candidate(kind="gravity_tilt", where=("world",), columns=columns)


EFFECTS = (
    Effect(
        kind="plate_bias",
        meaning="something constant is added to what the plate measures",
        candidates=propose_plate_biases,
    ),
    Effect(
        kind="plate_gain",
        meaning="the plate measures a multiple of the true force",
        candidates=propose_plate_gains,
    ),
    Effect(
        kind="plate_position",
        meaning="the plate lies elsewhere, so that its centre of pressure is shifted",
        candidates=propose_plate_positions,
    ),
    Effect(kind="plate_rotation", meaning="the plate is turned", candidates=propose_plate_rotations),
    Effect(
        kind="force_delay",
        meaning="the forces come later (or earlier) than the markers",
        candidates=propose_force_delays,
    ),
    Effect(
        kind="gravity_tilt",
        meaning="the laboratory's vertical is not vertical",
        candidates=propose_gravity_tilt,
    ),
)
