"""What the parameters and the header of a C3D file state, in the numbers of three makes of processor."""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from scaling_service.core import errors
from scaling_service.model.trial import Repair

BLOCK = 512

RATES_HZ = (0.5, 1e5)  # chosen: a frame in two seconds to beyond any camera

Numbers = NDArray[Any]


@dataclasses.dataclass(frozen=True, slots=True)
class Processor:
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


# --- header and parameters ---


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """All that a file says of itself."""

    processor: Processor
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
    repairs: tuple[Repair, ...] = dataclasses.field(default=())

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


def read_facts(content: bytes) -> Facts:
    """Header and parameters as the processor wrote them under whose reading they make sense."""
    begin = BLOCK * (content[0] - 1)
    if not 0 < begin <= len(content) - 4:
        raise errors.FileUnreadable(
            "the C3D file is damaged: its header does not lead to its parameters",
            field="header word 1",
            remedy="Copy or export it again",
        )
    stated = content[begin + 3]
    makes = (Processor(84, "Intel", "<"), Processor(85, "DEC", "<"), Processor(86, "SGI/MIPS", ">"))
    for processor in sorted(makes, key=lambda p: p.code != stated):
        words = [0, *processor.read_words(content, 0, 12).tolist()]
        blocks = content[begin + 2]
        end = min(len(content), begin + BLOCK * blocks) if blocks else len(content)
        parameters, broken = _read_parameters(content, begin + 4, end, processor)
        notes = [Repair("header", "parameters", detail) for detail in broken]
        facts = Facts(
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
        rates = [facts.rate, facts.number("POINT", "RATE")]
        if "POINT" in facts.parameters and any(RATES_HZ[0] <= rate <= RATES_HZ[1] for rate in rates):
            break
    else:
        raise errors.FileUnreadable(
            "the C3D file is damaged: no parameters POINT with a frame rate can be read",
            field="POINT:RATE",
            remedy="Copy or export it again",
        )
    if processor.code == stated:
        return facts
    said = f"type {stated} is stated; its numbers are those of {processor.name} ({processor.code})"
    note = Repair("header", "processor type", said)
    return dataclasses.replace(facts, repairs=(*facts.repairs, note))


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class _Entry:
    """A group or one of its parameters."""

    name: str
    group: int  # of a group itself the negative of its number
    value: Any
    after: int  # where its own bytes end
    linked: int  # where it says that the next begins; 0 of the last


def _read_parameters(
    content: bytes, at: int, end: int, processor: Processor
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
    if not entries or (at < end and content[at] and any(content[at + 2 : min(end, at + 8)])):
        broken.append("the list of parameters breaks off in what cannot be read")
    groups = {-entry.group: entry.name for entry in entries if entry.group < 0}
    found: dict[str, dict[str, Any]] = {name: {} for name in groups.values()}
    for entry in entries:
        if entry.group > 0:
            found.setdefault(groups.get(entry.group, ""), {}).setdefault(entry.name, entry.value)
    return found, broken


def _read_entry(content: bytes, at: int, end: int, processor: Processor) -> _Entry | None:
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
        after = link + 3 + content[link + 2]
        return _Entry(name=name, group=group, value=None, after=after, linked=linked)
    if link + 4 > end:
        return None
    size, rank = struct.unpack_from("bB", content, link + 2)
    begin = link + 4 + rank
    if size not in (-1, 1, 2, 4) or rank > 7 or begin > end:
        return None
    shape = tuple(content[link + 4 : begin])
    count = int(np.prod(shape, dtype=np.int64))
    after = begin + count * abs(size)
    if after >= end:
        return None
    value: list[Any]
    if not count:  # of an empty array's other lengths nothing would remain but lists, billions of them
        value = []
    elif size == -1:
        width = shape[0] if shape else 1
        value = [_decode_text(content[k : k + width]) for k in range(begin, begin + count, width)]
    else:
        if size == 4:
            numbers = processor.read_reals(content, begin, count)
        elif size == 2:
            numbers = processor.read_words(content, begin, count, signed=True)
        else:
            numbers = np.frombuffer(content, "i1", count, begin)
        value = numbers.reshape(shape or (1,), order="F").tolist()
    return _Entry(name=name, group=group, value=value, after=after + 1 + content[after], linked=linked)


def _decode_text(content: bytes) -> str:
    """Text whose bytes are not UTF-8 is taken as Latin-1."""
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    return text.replace("\x00", " ").strip()


def join_numbered(group: Mapping[str, Any], name: str) -> list[Any]:
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


def report_no_frame() -> errors.TrialUnusable:
    """What is said of a file with labels and no frame."""
    return errors.TrialUnusable(
        "the file holds no frame", field="POINT:FRAMES", remedy="Record or export it again"
    )
