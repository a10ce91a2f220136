"""Images made once for all tests of bones and images."""

from __future__ import annotations

import pytest

from scaling_service.virtual.example import VirtualImage, make_virtual_image
from scaling_service.virtual.subject import make_virtual_subject
from tests.studies.imaged import EXACT, SEEDS, SHORT, Imaged, seen


@pytest.fixture(scope="session")
def exact() -> dict[int, Imaged]:
    """Persons whose images are free of errors."""
    return {seed: seen(seed, EXACT) for seed in SEEDS}


@pytest.fixture(scope="session")
def blurred() -> dict[int, VirtualImage]:
    """Images of two of them with the usual errors."""
    return {seed: make_virtual_image(make_virtual_subject(seed, SHORT)) for seed in SEEDS[:2]}
