"""C3D: what a binary recording holds.

A file states its layout several times: in its header, in its parameters and by its own length. Each of these
is one witness. The layout that most of them support and that the length allows is taken; where two are
supported equally well, the file is refused. The format is that of the C3D user guide (Motion Lab Systems,
2008).
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.errors import FileUnreadable, TrialUnusable
from scaling_service.files.tables import read_bytes
from scaling_service.model.trial import Array, Repair

COMPUTED = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "MODELED_MARKERS")
"""Parameters of POINT in which Vicon Nexus lists the points that are results, not markers."""

_BLOCK = 512
_SATURATED = 65535  # a recording that reaches this frame keeps its true length elsewhere
_RATES_HZ = (0.5, 1e5)  # chosen: a frame in two seconds to beyond any camera
_SAME = 1e-4  # chosen: rates that differ by a smaller share are one, rounded
_KIND = "a C3D file"

Numbers = NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class C3dFile:
    """What a C3D file holds, in its own units.

    ``parameters``: group to name to list of values; numeric arrays as nested lists, first index first.
    """

    name: str
    points: Array  # (n_frames, n_points, 3); in ``point_unit``; NaN where not seen
    labels: tuple[str, ...]  # empty where a point has none
    computed: frozenset[str]  # labels of points that are results (angles, moments, virtual points)
    point_unit: str
    rate_hz: float  # NaN where nothing states it
    analog: Array  # (n_samples, n_channels); scaled to the units of ``ANALOG:UNITS``
    parameters: Mapping[str, Mapping[str, Any]]
    descriptions: tuple[str, ...] = ()  # of the points, as far as they have any
    has_rotations: bool = False  # whether it holds segment poses (markerless systems)
    repairs: tuple[Repair, ...] = ()  # what its statements disagree on, and what was decided

    @property
    def analog_rate_hz(self) -> float:
        """Samples per second of the analog signals; NaN where there are none."""
        frames = len(self.points)
        return self.rate_hz * len(self.analog) / frames if frames and len(self.analog) else float("nan")


def read_c3d_file(path: str | os.PathLike[str]) -> C3dFile:
    """Read everything that a C3D file holds, without judging it.

    Raises FileUnreadable if it is absent, empty, cut off, not C3D, or its statements of what it holds
    contradict each other beyond a decision. Raises TrialUnusable if it holds no frame.
    """
    file = Path(path)
    content = read_bytes(file, _KIND)
    # The second byte of every C3D file is 80 (C3D user guide, "Header section"); a header has 512 bytes.
    if len(content) < _BLOCK or content[1] != 0x50:
        raise FileUnreadable(
            "this is not a C3D file, or it is cut off", file=file, remedy="Export it again as C3D"
        )
    facts = _read_facts(content, file)
    layout, of_layout = _find_layout(facts, len(content), file)
    rate, of_rate = _find_rate(facts, layout, file)
    points, analog = _decode(content, facts, layout, file)
    about = facts.parameters.get("POINT", {})

    def list_texts(name: str) -> tuple[str, ...]:
        texts = [str(text).strip() for text in _join_numbered(about, name)][: layout.points]
        return tuple(texts + [""] * (layout.points - len(texts)))

    return C3dFile(
        name=file.stem,
        points=points,
        labels=list_texts("LABELS"),
        descriptions=list_texts("DESCRIPTIONS"),
        computed=frozenset(str(name).strip() for kind in COMPUTED for name in _join_numbered(about, kind))
        - {""},
        point_unit=str(take_first_value(about.get("UNITS")) or "").strip(),
        rate_hz=rate,
        analog=analog,
        parameters=facts.parameters,
        has_rotations="ROTATION" in facts.parameters,
        repairs=(*facts.repairs, *of_layout, *of_rate),
    )


# --- numbers of three makes of processor ---


@dataclass(frozen=True, slots=True)
class _Processor:
    """How numbers stand in a file."""

    code: int
    name: str
    order: Literal["<", ">"]

    def read_words(self, content: bytes, at: int, count: int, *, signed: bool = False) -> Numbers:
        """Whole numbers of two bytes."""
        return np.frombuffer(content, f"{self.order}{'i' if signed else 'u'}2", count, at)

    def read_reals(self, content: bytes, at: int, count: int) -> Numbers:
        """Numbers of four bytes.

        DEC's F_floating has its halves the other way round and an exponent that is larger by two.
        """
        if self.code == 85:
            halves = np.frombuffer(content, "<u4", count, at)
            with np.errstate(invalid="ignore"):
                return ((halves << 16) | (halves >> 16)).view("<f4") * np.float32(0.25)
        return np.frombuffer(content, f"{self.order}f4", count, at)

    def read_real(self, content: bytes, at: int) -> float:
        """One number of four bytes."""
        return float(self.read_reals(content, at, 1)[0])


_PROCESSORS = (
    _Processor(84, "Intel", "<"),
    _Processor(85, "DEC", "<"),
    _Processor(86, "SGI/MIPS", ">"),
)


# --- header and parameters ---


@dataclass(frozen=True, slots=True, kw_only=True)
class _Facts:
    """All that a file says of itself."""

    processor: _Processor
    points: int  # the header's words 2 to 12 from here on
    analogs: int
    first: int
    last: int
    scale: float
    start: int
    per_frame: int
    rate: float
    parameters: Mapping[str, Mapping[str, Any]]
    behind: int  # block that follows the parameters
    repairs: tuple[Repair, ...] = field(default=())

    def number(self, group: str, name: str) -> float:
        """The first number of a parameter; NaN where there is none."""
        value = take_first_value(self.parameters.get(group, {}).get(name))
        return float(value) if isinstance(value, int | float) else float("nan")

    def count(self, group: str, name: str) -> int | None:
        """A parameter that counts something; what was written as a signed word is taken without its sign."""
        value = self.number(group, name)
        if not np.isfinite(value) or value != round(value) or not -32768 <= value < 2**31:
            return None
        return int(value) + (65536 if value < 0 else 0)


def _read_facts(content: bytes, file: Path) -> _Facts:
    """Header and parameters as the processor wrote them under whose reading they make sense."""
    begin = _BLOCK * (content[0] - 1)
    if not 0 < begin <= len(content) - 4:
        raise FileUnreadable(
            "the C3D file is damaged: its header does not lead to its parameters",
            file=file,
            field="header word 1",
            remedy="Copy or export it again",
        )
    stated = content[begin + 3]
    for processor in sorted(_PROCESSORS, key=lambda p: p.code != stated):
        facts = _read_as(content, begin, processor)
        rates = [facts.rate, facts.number("POINT", "RATE")]
        if "POINT" in facts.parameters and any(_RATES_HZ[0] <= rate <= _RATES_HZ[1] for rate in rates):
            break
    else:
        raise FileUnreadable(
            "the C3D file is damaged: no parameters POINT with a frame rate can be read",
            file=file,
            field="POINT:RATE",
            remedy="Copy or export it again",
        )
    if processor.code == stated:
        return facts
    said = f"type {stated} is stated; its numbers are those of {processor.name} ({processor.code})"
    note = Repair(what="header", where="processor type", detail=said)
    return replace(facts, repairs=(*facts.repairs, note))


def _read_as(content: bytes, begin: int, processor: _Processor) -> _Facts:
    words = [0, *processor.read_words(content, 0, 12).tolist()]
    blocks = content[begin + 2]
    end = min(len(content), begin + _BLOCK * blocks) if blocks else len(content)
    parameters, broken = _read_parameters(content, begin + 4, end, processor)
    notes = [Repair(what="header", where="parameters", detail=detail) for detail in broken]
    return _Facts(
        processor=processor,
        points=words[2],
        analogs=words[3],
        first=words[4],
        last=words[5],
        scale=processor.read_real(content, 12),
        start=words[9],
        per_frame=words[10],
        rate=processor.read_real(content, 20),
        parameters=parameters,
        behind=content[0] + blocks if blocks else 0,
        repairs=tuple(notes),
    )


@dataclass(frozen=True, slots=True)
class _Entry:
    """A group or one of its parameters."""

    name: str
    group: int  # of a group itself the negative of its number
    value: Any
    after: int  # where its own bytes end
    linked: int  # where it says that the next begins; 0 of the last


def _read_parameters(
    content: bytes, at: int, end: int, processor: _Processor
) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Group to parameter to value, and what was wrong with the list.

    Each entry says where the next one begins, and has an end of its own. Where the two differ, what is an
    entry there is followed.
    """
    entries: list[_Entry] = []
    broken: list[str] = []
    while (entry := _read_entry(content, at, end, processor)) is not None:
        entries.append(entry)
        at = entry.linked
        if at != entry.after and _read_entry(content, at, end, processor) is None:
            at = entry.after
            if _read_entry(content, at, end, processor) is not None:
                broken.append(f"what follows '{entry.name}' was found behind it, not where it is said to be")
    if not entries or (at < end and content[at] and not _is_end(content, at, end)):
        broken.append("the list of parameters breaks off in what cannot be read")
    groups = {-entry.group: entry.name for entry in entries if entry.group < 0}
    found: dict[str, dict[str, Any]] = {name: {} for name in groups.values()}
    for entry in entries:
        if entry.group > 0:
            found.setdefault(groups.get(entry.group, ""), {}).setdefault(entry.name, entry.value)
    return found, broken


def _is_end(content: bytes, at: int, end: int) -> bool:
    """Whether an entry without a name, or what some writers leave behind the last one, stands here."""
    return not any(content[at + 2 : min(end, at + 8)])


def _read_entry(content: bytes, at: int, end: int, processor: _Processor) -> _Entry | None:
    """The entry that begins here; None if there is none."""
    if not 0 < at <= end - 5:
        return None
    # A locked entry has its name's length below zero.
    length, group = struct.unpack_from("bb", content, at)
    length = abs(length)
    link = at + 2 + length
    if not length or not group or link + 3 > end:
        return None
    raw = content[at + 2 : link]
    if not all(byte >= 32 for byte in raw):
        return None
    name = _decode_text(raw).upper()
    offset = int(processor.read_words(content, link, 1)[0])
    linked = link + offset if offset else 0
    if group < 0:
        return _Entry(name, group, None, link + 3 + content[link + 2], linked)
    size, rank = struct.unpack_from("bB", content, link + 2)
    begin = link + 4 + rank
    if size not in (-1, 1, 2, 4) or rank > 7 or begin > end:
        return None
    shape = tuple(content[link + 4 : begin])
    count = int(np.prod(shape, dtype=np.int64))
    after = begin + count * abs(size)
    if after >= end:
        return None
    value = _read_value(content, begin, size, shape, count, processor)
    return _Entry(name, group, value, after + 1 + content[after], linked)


def _read_value(
    content: bytes, at: int, size: int, shape: tuple[int, ...], count: int, processor: _Processor
) -> list[Any]:
    if size == -1:
        width = shape[0] if shape else 1
        texts = [content[k : k + width] for k in range(at, at + count, width)] if count else []
        return [_decode_text(text) for text in texts]
    if size == 4:
        values = processor.read_reals(content, at, count)
    elif size == 2:
        values = processor.read_words(content, at, count, signed=True)
    else:
        values = np.frombuffer(content, "i1", count, at)
    plain: list[Any] = values.reshape(shape or (1,), order="F").tolist()
    return plain


def _decode_text(content: bytes) -> str:
    """Text whose bytes are not UTF-8 is taken as Latin-1."""
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    return text.replace("\x00", " ").strip()


# --- where the frames are ---


@dataclass(frozen=True, slots=True)
class _Layout:
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


@dataclass(frozen=True, slots=True)
class _Witness:
    """One statement of a file on its layout."""

    where: str
    of: str  # the attribute of a layout
    value: int
    modulo: int = 0  # of counts that were written into one word

    def supports(self, layout: _Layout) -> bool:
        """Whether a layout agrees with it."""
        have = int(getattr(layout, self.of))
        return have == self.value or bool(self.modulo and (have - self.value) % self.modulo == 0)


def _list_witnesses(facts: _Facts) -> list[_Witness]:
    """What header and parameters say, as far as they can know it."""
    ratio = facts.number("ANALOG", "RATE") / _first_usable(facts.number("POINT", "RATE"), facts.rate)
    whole = round(ratio) if np.isfinite(ratio) and 0 < ratio < 65536 else 0
    said = [
        ("header word 2", "points", facts.points),
        ("POINT:USED", "points", facts.count("POINT", "USED")),
        ("POINT:LABELS", "points", len(_join_numbered(facts.parameters.get("POINT", {}), "LABELS")) or None),
        ("header word 3", "analogs", facts.analogs),
        ("ANALOG:USED", "channels", facts.count("ANALOG", "USED")),
        ("header word 10", "per_frame", facts.per_frame or None),
        ("ANALOG:RATE", "per_frame", whole if whole and abs(ratio - whole) < _SAME * ratio else None),
        ("header word 9", "start", facts.start or None),
        ("POINT:DATA_START", "start", facts.count("POINT", "DATA_START") or None),
        ("the length of the parameters", "start", facts.behind or None),
        ("header words 7 and 8", "real", _say_form(facts.scale)),
        ("POINT:SCALE", "real", _say_form(facts.number("POINT", "SCALE"))),
    ]
    witnesses = [_Witness(where, of, value) for where, of, value in said if value is not None]
    return witnesses + _list_frame_counts(facts)


def _list_frame_counts(facts: _Facts) -> list[_Witness]:
    """Counts of frames: one word holds them up to 65,535, and what is longer stands elsewhere."""
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
    return found


def _say_form(scale: float) -> int | None:
    """Real numbers have a scale below zero; 0 and NaN say nothing."""
    return int(scale < 0) if scale and np.isfinite(scale) else None


def _first_usable(*rates: float) -> float:
    return next((rate for rate in rates if _RATES_HZ[0] <= rate <= _RATES_HZ[1]), float("nan"))


def _find_layout(facts: _Facts, length: int, file: Path) -> tuple[_Layout, tuple[Repair, ...]]:
    """The layout that most witnesses support and the file's length allows."""
    witnesses = _list_witnesses(facts)
    scored = [
        (sum(w.supports(layout) for w in witnesses), _is_filled(layout, length), layout)
        for layout in _list_layouts(witnesses, length)
    ]
    fitting = [entry for entry in scored if _count_held(entry[2], length) >= entry[2].frames]
    if not fitting:
        raise _report_cut(scored, length, file)
    fitting.sort(key=lambda entry: entry[:2], reverse=True)
    best, *others = fitting
    # Lists of labels may be longer or shorter than the points; what rates disagree on is said with the rates.
    against = [
        w for w in witnesses if not (w.supports(best[2]) or w.where in ("POINT:LABELS", "ANALOG:RATE"))
    ]
    if not best[2].frames:
        raise report_no_frame(file)
    if others and others[0][:2] == best[:2]:
        rivals = {w.of for w in witnesses if w.supports(best[2]) != w.supports(others[0][2])}
        where = ", ".join(dict.fromkeys(f"{w.where} ({w.value})" for w in witnesses if w.of in rivals))
        raise FileUnreadable(
            f"the C3D file contradicts itself and its length does not decide: {where}",
            file=file,
            field=next(w.where for w in witnesses if w.of in rivals),
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
        notes.append(Repair(what="header", where=w.where, detail=detail))
    return best[2], tuple(notes)


def _count_held(layout: _Layout, length: int) -> int:
    """Whole frames that stand between the first and the end of the file."""
    left = length - _BLOCK * (layout.start - 1)
    return left // layout.frame_bytes if layout.frame_bytes and left > 0 else 0


def _is_filled(layout: _Layout, length: int) -> bool:
    """Whether the frames reach into the file's last block; some writers fill one more."""
    rest = length - _BLOCK * (layout.start - 1) - layout.frames * layout.frame_bytes
    return 0 <= rest < _BLOCK


def _list_layouts(witnesses: Sequence[_Witness], length: int) -> Iterable[_Layout]:
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
        empty = _Layout(points, count, step if count else 1, 0, start, bool(real))
        held = _count_held(empty, length)
        long = {w.value + w.modulo * ((held - w.value) // w.modulo) for w in witnesses if w.modulo}
        frames = {*values("frames"), *(n for n in long if n > 0)}
        for n in sorted(frames or {held}):
            yield _Layout(points, count, step if count else 1, n, start, bool(real))


def _report_cut(
    scored: Sequence[tuple[int, bool, _Layout]], length: int, file: Path
) -> FileUnreadable | TrialUnusable:
    if not scored:
        return FileUnreadable(
            "the C3D file is damaged: nothing states what a frame holds",
            file=file,
            field="POINT:USED",
            remedy="Copy or export it again",
        )
    layout = max(scored, key=lambda entry: entry[0])[2]
    held = _count_held(layout, length)
    return FileUnreadable(
        f"the file is cut off: {layout.frames} frames are stated, and it ends after {held}",
        file=file,
        field="POINT:FRAMES",
        remedy="Copy or export it again",
    )


# --- rates ---


def _find_rate(facts: _Facts, layout: _Layout, file: Path) -> tuple[float, tuple[Repair, ...]]:
    """The rate of frames that most statements support, and what disagrees with it."""
    analog = facts.number("ANALOG", "RATE")
    stated = {
        "POINT:RATE": facts.number("POINT", "RATE"),
        "header words 11 and 12": facts.rate,
        "TRIAL:CAMERA_RATE": facts.number("TRIAL", "CAMERA_RATE"),
    }
    if layout.channels:
        stated["ANALOG:RATE"] = analog / layout.per_frame
    usable = {where: rate for where, rate in stated.items() if _RATES_HZ[0] <= rate <= _RATES_HZ[1]}
    support = {
        where: sum(abs(rate - other) <= _SAME * rate for other in usable.values())
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
            file=file,
            field="POINT:RATE",
            remedy="Correct the rate in the recording software and export again",
        )
    notes = [
        Repair(
            what="rate",
            where=where,
            detail=f"{_say_rate(where, value, layout)}; {rate:g} Hz was taken for the frames",
        )
        for where, value in stated.items()
        if where != "TRIAL:CAMERA_RATE" and not abs(value - rate) <= _SAME * rate
    ]
    return rate, tuple(notes)


def _say_rate(where: str, value: float, layout: _Layout) -> str:
    if not np.isfinite(value):
        return "no rate is stated"
    if where != "ANALOG:RATE":
        return f"it says {value:g} Hz"
    return f"it says {value * layout.per_frame:g} Hz, the file holds {layout.per_frame} samples a frame"


# --- frames ---


def _decode(content: bytes, facts: _Facts, layout: _Layout, file: Path) -> tuple[Array, Array]:
    """Points (n_frames, n_points, 3), NaN where not seen, and analog signals (n_samples, n_channels)."""
    at, count = _BLOCK * (layout.start - 1), layout.frames * layout.words
    if layout.real:
        numbers = facts.processor.read_reals(content, at, count)
    else:
        numbers = facts.processor.read_words(content, at, count, signed=True)
    table = numbers.reshape(layout.frames, layout.words)
    points = table[:, : 4 * layout.points].reshape(layout.frames, layout.points, 4).astype(float)
    xyz = points[..., :3] if layout.real else points[..., :3] * _find_scale(facts, file)
    seen = points[..., 3] >= 0  # the sign of the fourth number
    samples = layout.frames * layout.per_frame if layout.channels else 0
    analog = table[:, 4 * layout.points :].reshape(samples, layout.channels).astype(float)
    return np.where(seen[..., None], xyz, np.nan), _scale_analog(analog, facts)


def _find_scale(facts: _Facts, file: Path) -> float:
    """What one step of whole numbers is in units of length."""
    scales = [s for s in (facts.number("POINT", "SCALE"), facts.scale) if np.isfinite(s) and s > 0]
    if not scales or abs(scales[0] - scales[-1]) > _SAME * scales[0]:
        said = " and ".join(f"{s:g}" for s in scales) or "none"
        raise FileUnreadable(
            f"the scale of the points cannot be told: parameters and header state {said}",
            file=file,
            field="POINT:SCALE",
            remedy="Export it again",
        )
    return scales[0]


def _scale_analog(analog: Array, facts: _Facts) -> Array:
    """Signals in the units of ANALOG:UNITS: (number - offset) · scale · general scale."""
    about = facts.parameters.get("ANALOG", {})
    channels = analog.shape[1]

    def list_values(name: str, usual: float) -> Array:
        values = [v for v in np.ravel(_join_numbered(about, name)).tolist() if isinstance(v, int | float)]
        return np.array((values + [usual] * channels)[:channels], float)

    offset, general = list_values("OFFSET", 0.0), facts.number("ANALOG", "GEN_SCALE")
    if str(take_first_value(about.get("FORMAT")) or "").upper().startswith("UNSIGNED"):
        analog, offset = np.where(analog < 0, analog + 65536.0, analog), offset % 65536
    scaled: Array = (analog - offset) * list_values("SCALE", 1.0) * (general if np.isfinite(general) else 1.0)
    return scaled


def _join_numbered(group: Mapping[str, Any], name: str) -> list[Any]:
    """A list that continues under NAME2, NAME3 … because one parameter holds at most 255 items."""
    values: list[Any] = []
    for key in (name, *(f"{name}{k}" for k in range(2, 256))):
        if key not in group:
            break
        value = group[key]
        values += value if isinstance(value, list) else [value]
    return values


def take_first_value(value: Any) -> Any:
    """The first of a parameter's values, however they are nested; None where there is none."""
    while isinstance(value, list):
        value = value[0] if value else None
    return value


def report_no_frame(file: Path) -> TrialUnusable:
    """What is said of a file with labels and no frame."""
    return TrialUnusable(
        "the file holds no frame", file=file, field="POINT:FRAMES", remedy="Record or export it again"
    )
