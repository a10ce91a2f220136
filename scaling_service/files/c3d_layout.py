"""Where the frames of a C3D file are, and how fast they follow each other.

A file states its layout several times: in its header, in its parameters and by its own length. Each of these
is one witness. The layout that most of them support and that the length allows is taken; where two are
supported equally well, the file is refused.
"""

from __future__ import annotations

import dataclasses
from collections import abc
from itertools import product

import numpy as np

from scaling_service.core.errors import FileUnreadable
from scaling_service.files import c3d_parameters
from scaling_service.model.trial import Repair

_SATURATED = 65535  # a recording that reaches this frame keeps its true length elsewhere
SAME = 1e-4  # chosen: rates that differ by a smaller share are one, rounded


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """How frames stand in a file."""

    points: int
    channels: int
    per_frame: int  # samples of each channel in a frame
    frames: int
    start: int  # block, from 1
    real: bool  # whether numbers have four bytes

    @property
    def words(self) -> int:
        """Numbers in a frame."""
        return 4 * self.points + self.channels * self.per_frame

    @property
    def frame_bytes(self) -> int:
        """Length of a frame."""
        return self.words * (4 if self.real else 2)

    @property
    def analogs(self) -> int:
        """Analog numbers in a frame."""
        return self.channels * self.per_frame


@dataclasses.dataclass(frozen=True, slots=True)
class _Witness:
    """One statement of a file on its layout."""

    where: str
    of: str  # the attribute of a layout
    value: int
    modulo: int = 0  # of counts that were written into one word

    def supports(self, layout: Layout) -> bool:
        """Whether a layout agrees with it."""
        have = int(getattr(layout, self.of))
        return have == self.value or bool(self.modulo and (have - self.value) % self.modulo == 0)


def _list_witnesses(facts: c3d_parameters.Facts) -> list[_Witness]:
    """What header and parameters say, as far as they can know it."""
    rates = (facts.number("POINT", "RATE"), facts.rate)
    usable = next(
        (rate for rate in rates if c3d_parameters.RATES_HZ[0] <= rate <= c3d_parameters.RATES_HZ[1]),
        float("nan"),
    )
    ratio = facts.number("ANALOG", "RATE") / usable
    whole = round(ratio) if np.isfinite(ratio) and 0 < ratio < 65536 else 0
    said = [
        ("header word 2", "points", facts.points),
        ("POINT:USED", "points", facts.count("POINT", "USED")),
        (
            "POINT:LABELS",
            "points",
            len(c3d_parameters.join_numbered(facts.parameters.get("POINT", {}), "LABELS")) or None,
        ),
        ("header word 3", "analogs", facts.analogs),
        ("ANALOG:USED", "channels", facts.count("ANALOG", "USED")),
        ("header word 10", "per_frame", facts.per_frame or None),
        ("ANALOG:RATE", "per_frame", whole if whole and abs(ratio - whole) < SAME * ratio else None),
        ("header word 9", "start", facts.start or None),
        ("POINT:DATA_START", "start", facts.count("POINT", "DATA_START") or None),
        ("the length of the parameters", "start", facts.behind or None),
        ("header words 7 and 8", "real", _say_form(facts.scale)),
        ("POINT:SCALE", "real", _say_form(facts.number("POINT", "SCALE"))),
    ]
    witnesses = [_Witness(where, of, value) for where, of, value in said if value is not None]
    # Counts of frames: one word holds them up to 65,535, and what is longer stands elsewhere.
    found = []
    counted = facts.last - facts.first + 1
    if facts.last < _SATURATED:
        found.append(_Witness("header words 4 and 5", "frames", counted % 65536, 65536))
    stated = facts.count("POINT", "FRAMES")
    if stated and stated != _SATURATED:
        found.append(_Witness("POINT:FRAMES", "frames", stated, 65536 if stated < 65536 else 0))
    if long := facts.count("POINT", "LONG_FRAMES"):
        found.append(_Witness("POINT:LONG_FRAMES", "frames", long))
    trial = facts.parameters.get("TRIAL", {})
    fields = [np.ravel(trial.get(f"ACTUAL_{which}_FIELD", [])) for which in ("START", "END")]
    if all(len(f) and np.issubdtype(f.dtype, np.number) and np.isfinite(f).all() for f in fields):
        first, last = (int(f[0]) % 65536 + 65536 * (int(f[1]) % 65536 if len(f) > 1 else 0) for f in fields)
        if last >= first:
            found.append(_Witness("TRIAL:ACTUAL_END_FIELD", "frames", last - first + 1))
    return witnesses + found


def _say_form(scale: float) -> int | None:
    """Real numbers have a scale below zero; 0 and NaN say nothing."""
    return int(scale < 0) if scale and np.isfinite(scale) else None


def find_layout(facts: c3d_parameters.Facts, length: int) -> tuple[Layout, tuple[Repair, ...]]:
    """The layout that most witnesses support and the file's length allows."""
    witnesses = _list_witnesses(facts)
    scored = []
    for layout in _list_layouts(witnesses, length):
        # Whether the frames reach into the file's last block; some writers fill one more.
        rest = length - c3d_parameters.BLOCK * (layout.start - 1) - layout.frames * layout.frame_bytes
        scored.append((sum(w.supports(layout) for w in witnesses), 0 <= rest < c3d_parameters.BLOCK, layout))
    fitting = [entry for entry in scored if _count_held(entry[2], length) >= entry[2].frames]
    if not fitting:
        if not scored:
            raise FileUnreadable(
                "the C3D file is damaged: nothing states what a frame holds",
                field="POINT:USED",
                remedy="Copy or export it again",
            )
        layout = max(scored, key=lambda entry: entry[0])[2]
        held = _count_held(layout, length)
        raise FileUnreadable(
            f"the file is cut off: {layout.frames} frames are stated, and it ends after {held}",
            field="POINT:FRAMES",
            remedy="Copy or export it again",
        )
    fitting.sort(key=lambda entry: entry[:2], reverse=True)
    best, *others = fitting
    # Lists of labels may be longer or shorter than the points; what rates disagree on is said with the rates.
    against = [
        w for w in witnesses if not (w.supports(best[2]) or w.where in ("POINT:LABELS", "ANALOG:RATE"))
    ]
    if not best[2].frames:
        raise c3d_parameters.report_no_frame()
    if others and others[0][:2] == best[:2]:
        rivals = {w.of for w in witnesses if w.supports(best[2]) != w.supports(others[0][2])}
        told = {f"{w.where} ({w.value})": w.where for w in witnesses if w.of in rivals}
        raise FileUnreadable(
            "the C3D file contradicts itself and its length does not decide: "
            + (", ".join(told) or "its frames may begin in several places"),
            field=next(iter(told.values()), "header"),
            remedy="Export it again",
        )
    notes = []
    words = {"points": "points", "analogs": "analog numbers a frame", "channels": "analog channels"}
    words |= {"per_frame": "analog samples a frame", "frames": "frames", "start": "block of the first frame"}
    for w in against:
        taken = getattr(best[2], w.of)
        forms = ("whole numbers", "real numbers")
        said, have = (forms[w.value], forms[taken]) if w.of == "real" else (w.value, taken)
        detail = f"{words.get(w.of, 'form')}: it says {said}; the rest of the file shows {have}"
        notes.append(Repair("header", w.where, detail))
    return best[2], tuple(notes)


def _count_held(layout: Layout, length: int) -> int:
    """Whole frames that stand between the first and the end of the file."""
    left = length - c3d_parameters.BLOCK * (layout.start - 1)
    return left // layout.frame_bytes if layout.frame_bytes and left > 0 else 0


def _list_layouts(witnesses: abc.Sequence[_Witness], length: int) -> abc.Iterable[Layout]:
    """Every layout that can be put together from what is stated."""

    def values(of: str, *more: int) -> list[int]:
        return list(dict.fromkeys([*(w.value for w in witnesses if w.of == of), *more]))

    analogs, steps, channels = values("analogs"), values("per_frame"), values("channels")
    pairs = set(product(channels or [0], steps))
    for total in analogs:
        pairs |= {(total // step, step) for step in steps if total % step == 0}
        pairs |= {(count, total // count) for count in channels if count and total and total % count == 0}
        if not total or not steps:
            pairs.add((0, 1))
    for points, (count, step), start, real in product(
        values("points"), sorted(pairs), values("start"), values("real") or [0, 1]
    ):
        empty = Layout(
            points=points,
            channels=count,
            per_frame=step if count else 1,
            frames=0,
            start=start,
            real=bool(real),
        )
        held = _count_held(empty, length)
        long = {w.value + w.modulo * ((held - w.value) // w.modulo) for w in witnesses if w.modulo}
        frames = {*values("frames"), *(n for n in long if n > 0)}
        for n in sorted(frames or {held}):
            yield dataclasses.replace(empty, frames=n)


# --- rates ---


def find_rate(facts: c3d_parameters.Facts, layout: Layout) -> tuple[float, tuple[Repair, ...]]:
    """The rate of frames that most statements support, and what disagrees with it."""
    analog = facts.number("ANALOG", "RATE")
    stated = {
        "POINT:RATE": facts.number("POINT", "RATE"),
        "header words 11 and 12": facts.rate,
        "TRIAL:CAMERA_RATE": facts.number("TRIAL", "CAMERA_RATE"),
    }
    if layout.channels:
        stated["ANALOG:RATE"] = analog / layout.per_frame
    usable = {
        where: rate
        for where, rate in stated.items()
        if c3d_parameters.RATES_HZ[0] <= rate <= c3d_parameters.RATES_HZ[1]
    }
    support = {
        where: sum(abs(rate - other) <= SAME * rate for other in usable.values())
        for where, rate in usable.items()
    }
    if not support:
        return float("nan"), ()
    most = max(support.values())
    best = [where for where in support if support[where] == most]
    rate = usable[best[0]]
    if any(abs(usable[where] - rate) > 0.01 * rate for where in best):
        raise FileUnreadable(
            "the C3D file states different frame rates: "
            + ", ".join(f"{where} {usable[where]:g} Hz" for where in usable),
            field="POINT:RATE",
            remedy="Correct the rate in the recording software and export again",
        )
    notes = []
    for where, value in stated.items():
        if where == "TRIAL:CAMERA_RATE" or abs(value - rate) <= SAME * rate:
            continue
        said = f"it says {value:g} Hz" if np.isfinite(value) else "no rate is stated"
        if where == "ANALOG:RATE" and np.isfinite(value):
            said = (
                f"it says {value * layout.per_frame:g} Hz, the file holds {layout.per_frame} samples a frame"
            )
        detail = f"{said}; {rate:g} Hz was taken for the frames"
        notes.append(Repair("rate", where, detail))
    return rate, tuple(notes)
