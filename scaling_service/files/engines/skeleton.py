"""What is written for another engine."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Skeleton:
    """The text of a file, and what it does not carry of the model, in plain sentences."""

    text: str
    left_out: tuple[str, ...]
