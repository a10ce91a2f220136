"""The moves that a tree is made of."""

from __future__ import annotations

from dataclasses import dataclass

from scaling_service.numerics.multibody.laws import Array, TermArrays


@dataclass(frozen=True, slots=True, eq=False)
class Shift:
    """A translation by ``constant + sum of terms``, expressed in the frame reached so far (m)."""

    constant: Array
    terms: tuple[TermArrays, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A rotation about axis 0, 1 or 2 of the frame reached so far (rad)."""

    axis: int
    constant: float
    terms: tuple[TermArrays, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Fixed:
    """A constant rotation, (3, 3), mapping the new frame to the one reached so far."""

    rotation: Array


Move = Shift | Turn | Fixed


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """The moves that lead from a parent link to this one; parent ``NONE`` is ground."""

    parent: int
    moves: tuple[Move, ...]
