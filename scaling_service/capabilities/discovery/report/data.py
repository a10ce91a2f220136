"""What the report of a search is made from: the document that was written, and the pictures behind it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from scaling_service.capabilities.discovery.document import DiscoveryDocument
from scaling_service.model.results import Array
from scaling_service.report.scene import Scene


@dataclass(frozen=True, slots=True, eq=False)
class HeatMap:
    """How far model and recording are apart, place by place over time, before and after.

    Parameters
    ----------
    trial : str
    held_out : bool
    unit : str
        ``mm``, or ``floors`` for multiples of what noise leaves.
    places : sequence of str
    times : (n,), s
        Middles of the stretches that were averaged.
    before, after : (n_places, n)
        NaN where nothing was measured.
    """

    trial: str
    held_out: bool
    unit: str
    places: Sequence[str]
    times: Array
    before: Array
    after: Array


@dataclass(frozen=True, slots=True, eq=False)
class DiscoveryData:
    """What the report shows.

    Parameters
    ----------
    document : DiscoveryDocument
    meanings : mapping
        Kind of effect to what it is, in plain English.
    maps : sequence of HeatMap
    scene : Scene, optional
        The model without and with what was named; None where nothing was.
    """

    document: DiscoveryDocument
    meanings: Mapping[str, str]
    maps: Sequence[HeatMap] = ()
    scene: Scene | None = field(default=None)
