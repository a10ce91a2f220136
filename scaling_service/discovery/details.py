"""Further numbers of an effect, by the names of the results, and from which size it is named at all."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import optimize, stats

from scaling_service.discovery.additions import Sized, freedom_name
from scaling_service.discovery.candidates import Contact, Exchange, FreeMotion
from scaling_service.discovery.fitting import Account
from scaling_service.discovery.judging import Fitted
from scaling_service.discovery.loads import Wobbling
from scaling_service.discovery.profiles import Swing
from scaling_service.kernels.laws import Array

POWER = 0.9
"""Of naming an effect of the smallest size that is called nameable."""

_MM, _DEG = 1e3, 180.0 / np.pi


def details(effect: Sized, after: Account) -> Mapping[str, float]:
    """What the columns do not say: axes, spans of time, frequencies, sizes of free courses."""
    change = effect.candidate.change
    if isinstance(change, Exchange):
        return {"start_s": change.start_s, "end_s": change.end_s}
    if isinstance(change, FreeMotion):
        name, unit = freedom_name(effect.candidate), _DEG if change.kind == "rotation" else _MM
        rms = course_rms(after, name) * unit
        axis = dict(zip(("axis_x", "axis_y", "axis_z"), change.axis, strict=True))
        return {"rms_deg" if change.kind == "rotation" else "rms_mm": rms, **axis}
    if isinstance(change, Contact):
        point = dict(zip(("x_mm", "y_mm", "z_mm"), (_MM * v for v in change.point), strict=True))
        rms = _contact_rms(after, change, effect.candidate.trial)
        return {"start_s": change.start_s, "end_s": change.end_s, "rms_N": rms, **point}
    if effect.candidate.kind == "carried_load":
        mass = float(effect.size[0])
        place = effect.size[1:] / mass * _MM if mass else np.zeros(3)
        return dict(zip(("x_mm", "y_mm", "z_mm"), place.tolist(), strict=True))
    for column, _ in effect.columns:
        for source in (column.load, *(part.profile for part in column.parts)):
            if isinstance(source, Swing | Wobbling):
                return {"frequency_hz": source.frequency_hz, "damping": source.damping}
    return {}


def course_rms(after: Account, name: str) -> float:
    """RMS of an added coordinate over the trials that fitted it, about its mean."""
    courses = [
        item.q[:, item.task.model.coordinate_names.index(name)]
        for item in after.watched
        if item.role == "fit" and name in item.task.model.coordinate_names
    ]
    return float(np.sqrt(np.mean(np.concatenate(courses) ** 2))) if courses else float("nan")


def _contact_rms(after: Account, contact: Contact, trial: str | None) -> float:
    """RMS of the force inferred, N."""
    squares = [
        np.square(item.touched[(item.times >= contact.start_s) & (item.times <= contact.end_s), :3]).sum(
            axis=1
        )
        for item in after.weighed
        if trial in (None, item.name) and item.touched is not None
    ]
    return float(np.sqrt(np.concatenate(squares).mean())) if squares else float("nan")


def smallest_nameable(effect: Sized, fitted: Fitted, level: float) -> Mapping[str, float]:
    """Sizes of the columns, in proportion as found, from which nine in ten would pass the first gate.

    Parameters
    ----------
    level : float
        P-value that one candidate must reach.
    """
    k = len(fitted.size)
    spread = np.sqrt(np.diag(fitted.covariance)) if k else np.zeros(0)
    if not k or not np.isfinite(fitted.freedom) or fitted.freedom < 2.0 or not spread.all():
        return {}
    needed = stats.f.isf(level, k, fitted.freedom)

    def missed(strength: float) -> float:
        return float(stats.ncf.sf(needed, k, fitted.freedom, strength)) - POWER

    top = 10.0
    while missed(top) < 0.0 and top < 1e9:
        top *= 4.0
    strength = optimize.brentq(missed, 1e-9, top) if missed(top) > 0.0 else float("inf")
    found: Array = effect.size
    own = float(found @ np.linalg.pinv(fitted.covariance) @ found)
    share = np.sqrt(strength / own) if own > 0.0 else float("inf")
    return {
        column.name: abs(column.unit * size) * share
        for column, size in zip(effect.candidate.columns, found.tolist(), strict=True)
    }
