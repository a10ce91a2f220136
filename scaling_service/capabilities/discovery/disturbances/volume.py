"""A volume that moves: in every frame all markers are displaced by one linear function of their place.

A zoom that hunts, a camera that was pushed, a mount that sways: each shears or stretches what is seen by
another course in time. Markers that are read later the higher they are go along their own paths by a linear
function of their place, too. Each looks somewhat like several joints that the model locks, and no segment's
motion looks like it at all segments at once.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scaling_service.capabilities.discovery.disturbances.disturbance import Disturbance, DisturbanceLaw
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.settings import IDENTIFIABLE
from scaling_service.capabilities.discovery.evidence.statistics import assess_share
from scaling_service.capabilities.discovery.observations.oscillator import differentiate_places
from scaling_service.capabilities.discovery.observations.tracked import ROLES, Role, TrackedTrial, span
from scaling_service.core.threads import map_parallel

_CHUNK = 64  # frames at once
_ENOUGH = 256  # frames of a trial, equally spaced (chosen): each only adds numbers of its own
_NUMBERS = 9  # of a frame: six strains, for turns are the body's, and a delay along each axis
_MOST_OF_IT = 0.8  # of what stands above the noise (chosen: as for effects on held-out recordings)


def find_moving_volume(fit: Fit) -> Iterator[Disturbance]:
    """What the function takes off in any course, if that is most of what stands above the noise.

    So many numbers in every frame take off something of any effect, but of none the most.
    """
    gains = {role: _sum_gains(fit, role) for role in ROLES}
    gain, chance, _ = gains["fit"]
    if gain - chance > _MOST_OF_IT * MARKERS.above_noise(fit) > 0.0:
        law = "the measured volume moves: by another linear function of the place in every frame"
        # each block is as good as one frame
        p, held = (assess_share(taken, usual, _NUMBERS * blocks) for taken, usual, blocks in gains.values())
        held_out = held if gains["held_out"][2] else p
        yield Disturbance(
            where=("markers",), law=law, expected=gain - 2.0 * chance, p=p, held_out=held_out, flexible=True
        )


def _sum_gains(fit: Fit, role: Role) -> tuple[float, float, int]:
    """What the function takes off the trials of a role, what as many other numbers would, and the blocks."""
    items = [item for item in fit.tracked if item.role == role]
    taken = np.array([_fit_trial(item) for item in items]).reshape(-1, 2).sum(axis=0).tolist()
    blocks = sum(len(list(item.blocks(fit.settings.block_s))) for item in items)
    return taken[0], taken[1], blocks


def _fit_trial(item: TrackedTrial) -> tuple[float, float]:
    """What the function takes off the squares of a trial, and what as many other numbers would."""
    gaps, freedom = item.pose_free
    places = item.places
    away, (velocity, _) = places - places.mean(axis=(0, 1)), differentiate_places(places, item.step)
    shown = item.seen / item.floor

    def compute_gain(rows: slice) -> float:
        way, along = away[rows], velocity[rows]
        strains = np.einsum("nmk,ab->nmbka", way, np.eye(3)).reshape(*way.shape, 9)
        delays = np.einsum("nmk,nmb->nmbk", way, along)
        columns = np.concatenate([strains, delays], axis=3) * shown[rows][:, :, None, None]
        white = columns.reshape(len(way), -1, columns.shape[3])
        basis = span(item.pose_columns(rows))
        white -= basis.transpose(0, 2, 1) @ (basis @ white)
        across = white.transpose(0, 2, 1)
        bend, pull = across @ white, across @ gaps[rows, :, None]
        least = IDENTIFIABLE * np.trace(bend, axis1=1, axis2=2) + 1e-300  # where no marker is seen
        bend += least[:, None, None] * np.eye(bend.shape[1])
        return float(np.einsum("nkl,nkl->", pull, np.linalg.solve(bend, pull)))

    stride = -(-len(gaps) // _ENOUGH)
    every, length = slice(None, None, stride), stride * _CHUNK
    own = sum(map_parallel(compute_gain, [slice(k, k + length, stride) for k in range(0, len(gaps), length)]))
    numbers = float(_NUMBERS * len(gaps[every]))
    left = float(np.square(gaps[every]).sum()) - own
    others = left / max(float(freedom[every].sum()) - numbers, 1.0) * numbers
    return stride * own, stride * others


LAWS = (DisturbanceLaw(search=find_moving_volume),)
