"""C3D files byte by byte: every processor, both forms of storage, and any contradiction that a test wants.

It knows the format from the C3D user guide alone and shares nothing with the reader.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

INTEL, DEC, MIPS = 84, 85, 86
BLOCK = 512


def pack_reals(values: Any, processor: int) -> bytes:
    """Numbers of four bytes as a processor writes them."""
    numbers = np.ascontiguousarray(values, dtype="<f4")
    if processor == MIPS:
        return numbers.astype(">f4").tobytes()
    if processor == DEC:  # four times the number, halves exchanged
        return (numbers * np.float32(4)).view("<u2").reshape(-1, 2)[:, ::-1].tobytes()
    return numbers.tobytes()


def pack_words(values: Any, processor: int) -> bytes:
    """Numbers of two bytes as a processor writes them."""
    return np.asarray(values).astype(np.int64).astype(">u2" if processor == MIPS else "<u2").tobytes()


def make_c3d(
    points: NDArray[Any],
    labels: Sequence[str],
    analog: NDArray[Any] | None = None,
    *,
    processor: int = INTEL,
    real: bool = True,
    rate: float = 100.0,
    scale: float = 0.1,
    first: int = 1,
    header: Mapping[int, bytes] | None = None,
    parameters: Mapping[tuple[str, str], Any] | None = None,
) -> bytes:
    """The bytes of a file.

    ``points`` (n_frames, n_points, 3), mm; NaN where not seen. ``analog`` (n_frames, n_samples, n_channels).
    ``header``: byte to what is written there instead. ``parameters``: further or other ones, None: left out;
    text, whole numbers, real numbers, or an array of them (first index first).
    """
    frames, count = points.shape[:2]
    signals = np.zeros((frames, 0, 0)) if analog is None else analog
    samples, channels = signals.shape[1:]
    values: dict[tuple[str, str], Any] = {
        ("POINT", "USED"): count,
        ("POINT", "SCALE"): -scale if real else scale,
        ("POINT", "RATE"): float(rate),
        ("POINT", "DATA_START"): 0,
        ("POINT", "FRAMES"): min(frames, 65535),
        ("POINT", "UNITS"): ["mm"],
        ("ANALOG", "USED"): channels,
    }
    for k in range(0, len(labels), 255):
        values["POINT", f"LABELS{k // 255 + 1 if k else ''}"] = list(labels[k : k + 255])
    if channels:
        values["ANALOG", "RATE"] = float(rate * samples)
        values["ANALOG", "GEN_SCALE"] = 1.0
        values["ANALOG", "SCALE"] = np.full(channels, 0.5)
        values["ANALOG", "OFFSET"] = np.full(channels, 4)
        values["ANALOG", "LABELS"] = [f"A{k}" for k in range(channels)]
    values |= parameters or {}
    values = {key: value for key, value in values.items() if value is not None}
    blocks = -(-len(_pack_parameters(values, processor)) // BLOCK)
    start = 2 + blocks
    if values.get(("POINT", "DATA_START")) == 0:
        values["POINT", "DATA_START"] = start
    section = bytearray(_pack_parameters(values, processor).ljust(BLOCK * blocks, b"\0"))
    section[2:4] = bytes([blocks, processor])
    head = bytearray(BLOCK)
    head[0:2] = bytes([2, 0x50])
    ends = [min(first, 65535), min(first + frames - 1, 65535)]
    head[2:12] = pack_words([count, samples * channels, *ends, 10], processor)
    head[12:16] = pack_reals([-scale if real else scale], processor)
    head[16:20] = pack_words([start, samples], processor)
    head[20:24] = pack_reals([rate], processor)
    for at, content in (header or {}).items():
        head[at : at + len(content)] = content
    return bytes(head + section) + _pack_frames(points, signals, processor, real, scale)


def _pack_frames(points: Any, signals: Any, processor: int, real: bool, scale: float) -> bytes:
    seen = np.isfinite(points).all(-1, keepdims=True)
    rows = np.concatenate((np.where(seen, points, 0.0) / (1 if real else scale), np.where(seen, 0, -1)), -1)
    stored = signals / 0.5 + 4  # number = signal / scale + offset
    frames = len(points)
    table = np.concatenate((rows.reshape(frames, -1), stored.reshape(frames, -1)), axis=1)
    data = pack_reals(table, processor) if real else pack_words(np.rint(table), processor)
    return data.ljust(-(-len(data) // BLOCK) * BLOCK, b"\0")


def _pack_parameters(values: Mapping[tuple[str, str], Any], processor: int) -> bytes:
    groups = {name: k for k, name in enumerate(dict.fromkeys(group for group, _ in values), start=1)}
    entries = [(-k, name, b"") for name, k in groups.items()]
    entries += [
        (groups[group], name, _pack_value(value, processor)) for (group, name), value in values.items()
    ]
    content = bytearray(b"\1\x50\0\0")
    for k, (number, name, value) in enumerate(entries):
        link = 0 if k == len(entries) - 1 else 2 + len(value) + 1
        content += struct.pack("bb", len(name), number) + name.encode("latin-1")
        content += pack_words([link], processor) + value + b"\0"
    return bytes(content)


def _pack_value(value: Any, processor: int) -> bytes:
    if isinstance(value, list):  # of texts
        width = max((len(text) for text in value), default=1)
        shape = bytes([width, len(value)])
        return struct.pack("bB", -1, 2) + shape + "".join(t.ljust(width) for t in value).encode("latin-1")
    array = np.asarray(value)
    pack, size = (pack_reals, 4) if array.dtype.kind == "f" else (pack_words, 2)
    head = struct.pack("bB", size, array.ndim) + bytes(array.shape)
    return head + pack(array.ravel(order="F"), processor)
