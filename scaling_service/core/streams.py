"""Random numbers by name: the same whatever is drawn before, and by whichever worker."""

from __future__ import annotations

import hashlib

import numpy as np

_WORDS = 8  # of 32 bits: all of SHA-256


def stream(seed: int, *names: str | int) -> np.random.Generator:
    """A random generator that depends on the seed and the names only.

    Parameters
    ----------
    seed : int
        Not negative; the study's or the subject's.
    names : str or int
        What is drawn, from the general to the particular, such as ``"marker", "RASIS"``.

    Returns
    -------
    numpy.random.Generator
        PCG64 seeded by a SeedSequence whose spawn key is the SHA-256 of the names; streams of
        different names are independent.

    Raises
    ------
    ValueError
        A negative seed.

    Examples
    --------
    >>> int(stream(1, "marker", "RASIS").integers(1000)) == int(stream(1, "marker", "RASIS").integers(1000))
    True
    """
    if seed < 0:
        raise ValueError(f"a seed is not negative, and {seed} is")
    text = b"".join(_encode_name(name) for name in names)
    digest = hashlib.sha256(text).digest()
    key = tuple(int.from_bytes(digest[4 * k : 4 * k + 4], "little") for k in range(_WORDS))
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))


def _encode_name(name: str | int) -> bytes:
    """A name with its kind and length, so that no two paths read alike."""
    content = str(name).encode()
    return f"{type(name).__name__}:{len(content)}:".encode() + content
