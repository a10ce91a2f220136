"""What Futamure et al. claim, and what only truth can tell, one by one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from scaling_service.core.arrays import Array
from scaling_service.studies import claims
from scaling_service.studies.futamure import result as documents

LEVEL = 0.05
"""Of the tests (chosen: the usual one)."""

PAPER = {"classical": (7.0, 8.0, 8.0), "consistent": (3.0, 4.0, 3.0)}
"""Table 2: N, N, N m; standard deviations 0 and 2, 2, 3."""

WITHIN = 1.2
"""Held out over fitted that counts as alike (chosen: 20 %)."""


CLAIMS: claims.Claims[documents.FutamureDocument] = claims.Claims.read(__package__)


def assess_less(first: Array, second: Array) -> float:
    """One-sided p of Wilcoxon's signed-rank test that the first are smaller; NaN below five pairs."""
    if len(first) < 5:
        return float("nan")
    return float(scipy.stats.wilcoxon(first, second, alternative="less").pvalue)


def _list_recordings(
    study: documents.FutamureDocument, way: str, *, held_out: bool = False
) -> list[documents.WayEntry]:
    """One way's errors in all persons' recordings."""
    return [getattr(p.held_out if held_out else p.fitted, way) for p in study.persons]


def _list_wrenches(study: documents.FutamureDocument, way: str, *, held_out: bool = False) -> Array:
    """RMS errors of all persons, (n, 3)."""
    return np.array([found.wrench_rmse for found in _list_recordings(study, way, held_out=held_out)])


def _average_angle_errors(study: documents.FutamureDocument, way: str, *, held_out: bool = False) -> Array:
    """Mean RMS error of each person's angles, (n,), deg."""
    return np.array([np.mean(f.angle_rmse_deg) for f in _list_recordings(study, way, held_out=held_out)])


def _describe_errors(values: Array | list[float], digits: int = 1) -> str:
    return ", ".join(f"{v:.{digits}f}" for v in np.atleast_1d(values))


@CLAIMS.decide
def as_low(study: documents.FutamureDocument) -> claims.Answer:
    mean = _list_wrenches(study, "consistent").mean(axis=0)
    return claims.Answer(bool((mean <= PAPER["consistent"]).all()), f"{_describe_errors(mean)} N, N, N m")


@CLAIMS.decide
def lower(study: documents.FutamureDocument) -> claims.Answer:
    classical, ours = _list_wrenches(study, "classical"), _list_wrenches(study, "consistent")
    ratio = classical.mean(axis=0) / ours.mean(axis=0)
    p = [assess_less(ours[:, k], classical[:, k]) for k in range(3)]
    figures = (
        f"classical {_describe_errors(classical.mean(axis=0))}, {_describe_errors(ratio)} times as large; "
        f"p {_describe_errors(p, 3)}"
    )
    return _compare_tested(figures, p, bool((ratio >= 2.0).all()))


def _compare_tested(figures: str, p: Sequence[float], holds: bool = True) -> claims.Answer:
    if np.isnan(p).any():
        return claims.Answer(None, f"{figures} (too few persons for a test)")
    return claims.Answer(holds and max(p) < LEVEL, figures)


@CLAIMS.decide
def markers(study: documents.FutamureDocument) -> claims.Answer:
    classical, ours = (
        np.array([found.marker_rms_mm for found in _list_recordings(study, way)])
        for way in ("classical", "consistent")
    )
    p = assess_less(classical, ours)
    return _compare_tested(
        f"classical {classical.mean():.1f}, consistent {ours.mean():.1f} mm over all markers; p {p:.3f}", [p]
    )


@CLAIMS.decide
def knee(study: documents.FutamureDocument) -> claims.Answer:
    names = list(study.persons[0].marker_rms_mm)
    mean = np.mean([[person.marker_rms_mm[name][1] for name in names] for person in study.persons], axis=0)
    order = np.argsort(-mean)[:3]
    figures = ", ".join(f"{names[k]} {mean[k]:.1f} mm" for k in order)
    return claims.Answer(names[int(order[0])] in ("KNE", "THI"), figures)


@CLAIMS.decide
def loops(study: documents.FutamureDocument) -> claims.Answer:
    loops, settled = ([getattr(p, name) for p in study.persons] for name in ("loops", "converged"))
    return claims.Answer(
        all(settled) and max(loops) <= 2,
        f"{min(loops)} to {max(loops)} loops; settled in {sum(settled)} of {len(settled)}",
    )


@CLAIMS.decide
def angles(study: documents.FutamureDocument) -> claims.Answer:
    classical, ours = (_average_angle_errors(study, way) for way in ("classical", "consistent"))
    held = [_average_angle_errors(study, way, held_out=True) for way in ("classical", "consistent")]
    p = [assess_less(ours, classical), assess_less(held[1], held[0])]
    figures = (
        f"mean RMS error {classical.mean():.2f} and {ours.mean():.2f} deg, "
        f"nearer in {(ours < classical).sum()} of {len(ours)}; "
        f"held out {held[0].mean():.2f} and {held[1].mean():.2f} deg; p {_describe_errors(p, 3)}"
    )
    return _compare_tested(figures, p)


@CLAIMS.decide
def inertia(study: documents.FutamureDocument) -> claims.Answer:
    before, after = np.moveaxis(np.array([p.inertia_distance for p in study.persons]), 1, 0)
    whole = [np.sqrt((x**2).mean(axis=1)) for x in (before, after)]
    p = assess_less(whole[1], whole[0])
    tested = [assess_less(after[:, k], before[:, k]) for k in range(3)]
    parts = "; ".join(
        f"{name} {before[:, k].mean():.2f} to {after[:, k].mean():.2f} (p {tested[k]:.3f})"
        for k, name in enumerate(("masses", "centres of mass", "moments of inertia"))
    )
    figures = f"{whole[0].mean():.2f} to {whole[1].mean():.2f} SD of the tables, p {p:.3f}: {parts}"
    return _compare_tested(figures, [p])


@CLAIMS.decide
def held_out(study: documents.FutamureDocument) -> claims.Answer:
    fitted, held = (_list_wrenches(study, "consistent", held_out=h).mean(axis=0) for h in (False, True))
    ratio = held / fitted
    return claims.Answer(
        bool((ratio <= WITHIN).all()),
        f"held out {_describe_errors(held)}, {_describe_errors(ratio, 2)} of fitted",
    )


@CLAIMS.decide
def predicted(study: documents.FutamureDocument) -> claims.Answer:
    fitted, held = (_list_wrenches(study, "predicted", held_out=h) for h in (False, True))
    classical = _list_wrenches(study, "classical", held_out=True)
    p = [assess_less(held[:, k], classical[:, k]) for k in range(3)]
    ratio = held.mean(axis=0) / fitted.mean(axis=0)
    figures = (
        f"{_describe_errors(held.mean(axis=0))} against {_describe_errors(classical.mean(axis=0))} "
        f"with the table, p {_describe_errors(p, 3)}; {_describe_errors(ratio, 2)} of fitted"
    )
    return _compare_tested(figures, p, bool((ratio <= WITHIN).all()))


@CLAIMS.decide
def quick(study: documents.FutamureDocument) -> claims.Answer:
    slowest = max(person.seconds for person in study.persons)
    return claims.Answer(
        slowest <= 20.0, f"at most {slowest:.1f} s for 13 s at 100 Hz and a held-out recording"
    )
