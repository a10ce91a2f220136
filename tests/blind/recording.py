"""One recorded trial: what really happened, with all that is hidden in it, as cameras and plates tell it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.clutter import Clutter
from tests.blind.engine import Engine
from tests.blind.forces import RATE_HZ, Plates
from tests.blind.hidden import Hidden, Scene
from tests.blind.motions.motion import Motion
from tests.blind.motions.planted import Pressing, feet_wrenches, upsampled
from tests.blind.osim.engine import OsimEngine


@dataclass(frozen=True)
class Recording:
    """What goes into the files of a trial.

    Parameters
    ----------
    name : str
    times : ndarray, shape (n,), s
    labels : names, length m
    markers : ndarray, shape (n, m, 3), m
        NaN where not seen.
    plates : Plates, optional
    """

    name: str
    times: Array
    labels: tuple[str, ...]
    markers: Array
    plates: Plates | None


def record(
    given: Body,
    motion: Motion,
    pressing: Pressing | None,
    hidden: Sequence[Hidden],
    clutter: Clutter,
    rng: np.random.Generator,
    *,
    engine: Callable[[Body], Engine | OsimEngine] = Engine,
    force_rate_hz: float = RATE_HZ,
) -> Recording:
    """Let a person move and record it.

    Parameters
    ----------
    given : Body
        What the model says of the person; the truth differs by what is hidden.
    motion : Motion
    pressing : Pressing, optional
        Where the feet press; without it no forces are recorded.
    hidden : sequence of Hidden
        Those that affect this trial.
    engine : callable
        What moves a body.
    """
    body = given
    for thing in hidden:
        body = thing.body(body)
        motion = thing.motion(motion, rng)
    moving = engine(body)
    motion = motion.ordered(moving.coordinates)
    scene = Scene(body, motion, moving.poses(motion.q))
    markers = moving.markers(scene.poses)
    for thing in hidden:
        markers = thing.on_skin(scene, markers)
    for thing in hidden:
        markers = thing.seen(scene, markers)
    markers = clutter.on_markers(motion.times, markers, rng)
    for thing in hidden:
        markers = thing.labelled(motion.times, body.marker_names, markers)
    plates = None
    if pressing is not None:
        total = moving.ground_wrench(motion.q, motion.qd, motion.qdd)
        plates = _plates(scene, total, pressing, hidden, clutter, rng, force_rate_hz)
    return Recording(motion.name, motion.times, body.marker_names, markers, plates)


def _plates(
    scene: Scene,
    total: Array,
    pressing: Pressing,
    hidden: Sequence[Hidden],
    clutter: Clutter,
    rng: np.random.Generator,
    rate_hz: float,
) -> Plates:
    for thing in hidden:
        for extra, factor in ((thing.shaken(scene), 1.0), (thing.borne_elsewhere(scene), -1.0)):
            total = total + factor * extra if extra is not None else total
    times = scene.times
    n = round((times[-1] - times[0]) * rate_hz) + 1
    fine = times[0] + np.arange(n) / rate_hz
    plates = Plates.from_wrenches(fine, feet_wrenches(upsampled(times, total, fine), pressing.at(fine)))
    for thing in hidden:
        plates = thing.measured(plates)
    return clutter.on_plates(plates, rng)
