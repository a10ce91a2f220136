"""Force plates that lie, turn, measure or keep time otherwise than the recording says; a leaning vertical."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

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

_Fault = tuple[str, list[Column], str, Callable[[Array], bool] | None]
"""Kind, columns, what is noted of them, and whether sizes are plausible together."""


def _shift(plate: str, *axes: int) -> list[Column]:
    return [Column(name=f"{LETTERS[k]}_mm", unit=MM, load=PlateShift(plate, k)) for k in axes]


def _list_faults(plate: str) -> Iterator[_Fault]:
    """All that one plate may have.

    Readings without the plate's place do not tell about which point it is turned: about the vertical one is
    tried, too, that also shifts, the shift being that of the ground's origin.
    """
    turn = "about_vertical_deg"
    elsewhere = [Column(name=turn, unit=DEG, load=PlateTurn(plate, 1, "ground")), *_shift(plate, 0, 2)]
    leaning = [Column(name=f"tilt_{LETTERS[k]}_deg", unit=DEG, load=PlateTurn(plate, k)) for k in (0, 2)]
    biases = [Column(name=name, unit=1.0, load=PlateBias(plate, k)) for k, name in enumerate(_BIASES)]
    yield "plate_bias", biases, "", None
    yield "plate_gain", [Column(name="factor", unit=1.0, neutral=1.0, load=PlateGain(plate))], "", None
    yield "plate_position", _shift(plate, 0, 1, 2), "", None
    yield "plate_rotation", [Column(name=turn, unit=DEG, load=PlateTurn(plate, 1))], "", None
    yield "plate_rotation", elsewhere, "about another point", _is_turn_alone
    yield "plate_rotation", leaning, "leaning", None


def _propose(kind: str, scene: Scene) -> Iterator[Candidate]:
    """Every loaded plate, in all recordings and in each: every file says for itself where its plates lie."""
    for plate in scene.plates:
        for own, columns, note, together in _list_faults(plate):
            for trials in scene.scopes_of_plate(plate) if own == kind else ():
                yield Candidate(kind, (plate,), tuple(columns), trials=trials, note=note, together=together)


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
    *(
        Effect(kind, meaning, partial(_propose, kind), of_recording=True)
        for kind, meaning in (
            ("plate_bias", "something constant is added to what the plate measures"),
            ("plate_gain", "the plate measures a multiple of the true force"),
            ("plate_position", "the plate lies elsewhere, so that its centre of pressure is shifted"),
            ("plate_rotation", "the plate is turned"),
        )
    ),
    Effect(
        "force_delay",
        "the forces come later (or earlier) than the markers",
        propose_force_delays,
        of_recording=True,
    ),
    Effect(
        "gravity_tilt", "the laboratory's vertical is not vertical", propose_gravity_tilt, of_recording=True
    ),
)
