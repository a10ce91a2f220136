"""Force plates that lie, turn, measure or keep time otherwise than the recording says; a leaning vertical."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence

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

_Choice = tuple[Sequence[Column], str, Callable[[Array], bool] | None]
"""Columns, what is noted of them, and whether sizes are plausible together."""


def _at_plates(
    kind: str, choose: Callable[[str], Iterable[_Choice]], *, of_place: bool = False
) -> Callable[[Scene], Iterator[Candidate]]:
    """Every loaded plate, in all recordings and in each; how it lies is one for all (``of_place``)."""

    def propose(scene: Scene) -> Iterator[Candidate]:
        for plate in scene.plates:
            for columns, note, together in choose(plate):
                for trials in scene.scopes_of_plate(plate)[: 1 if of_place else None]:
                    yield Candidate(
                        kind=kind,
                        where=(plate,),
                        columns=tuple(columns),
                        trials=trials,
                        note=note,
                        together=together,
                    )

    return propose


def _shift(plate: str, *axes: int) -> list[Column]:
    return [Column(name=f"{LETTERS[k]}_mm", unit=MM, load=PlateShift(plate, k)) for k in axes]


def _choose_bias(plate: str) -> Iterator[_Choice]:
    yield [Column(name=name, unit=1.0, load=PlateBias(plate, k)) for k, name in enumerate(_BIASES)], "", None


def _choose_gain(plate: str) -> Iterator[_Choice]:
    yield [Column(name="factor", unit=1.0, neutral=1.0, load=PlateGain(plate))], "", None


def _choose_place(plate: str) -> Iterator[_Choice]:
    yield _shift(plate, 0, 1, 2), "", None


def _choose_rotations(plate: str) -> Iterator[_Choice]:
    """About the vertical and leaning.

    Readings without the plate's place do not tell about which point it is turned: about the vertical one is
    tried, too, that also shifts, the shift being that of the ground's origin.
    """
    name = "about_vertical_deg"
    elsewhere = [Column(name=name, unit=DEG, load=PlateTurn(plate, 1, "ground")), *_shift(plate, 0, 2)]
    leaning = [Column(name=f"tilt_{LETTERS[k]}_deg", unit=DEG, load=PlateTurn(plate, k)) for k in (0, 2)]
    yield [Column(name=name, unit=DEG, load=PlateTurn(plate, 1))], "", None
    yield elsewhere, "about another point", _is_turn_alone
    yield leaning, "leaning", None


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
        candidates=_at_plates("plate_bias", _choose_bias),
        of_recording=True,
    ),
    Effect(
        kind="plate_gain",
        meaning="the plate measures a multiple of the true force",
        candidates=_at_plates("plate_gain", _choose_gain),
        of_recording=True,
    ),
    Effect(
        kind="plate_position",
        meaning="the plate lies elsewhere, so that its centre of pressure is shifted",
        candidates=_at_plates("plate_position", _choose_place, of_place=True),
        of_recording=True,
    ),
    Effect(
        kind="plate_rotation",
        meaning="the plate is turned",
        candidates=_at_plates("plate_rotation", _choose_rotations, of_place=True),
        of_recording=True,
    ),
    Effect(
        kind="force_delay",
        meaning="the forces come later (or earlier) than the markers",
        candidates=propose_force_delays,
        of_recording=True,
    ),
    Effect(
        kind="gravity_tilt",
        meaning="the laboratory's vertical is not vertical",
        candidates=propose_gravity_tilt,
        of_recording=True,
    ),
)
