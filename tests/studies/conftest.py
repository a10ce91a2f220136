"""Images made once for all tests of bones and images."""

from __future__ import annotations

import pytest

from scaling_service.virtual.example import VirtualImage, make_virtual_image
from scaling_service.virtual.subject import make_virtual_subject
from tests.finished import make_once
from tests.studies.imaged import EXACT, SEEDS, SHORT, Imaged, seen


@pytest.fixture(scope="session")
def exact(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Imaged]:
    """Persons whose images are free of errors."""
    return make_once(tmp_path_factory, "exact_images", lambda: {seed: seen(seed, EXACT) for seed in SEEDS})


@pytest.fixture(scope="session")
def blurred(tmp_path_factory: pytest.TempPathFactory) -> dict[int, VirtualImage]:
    """Images of two of them with the usual errors."""
    return make_once(
        tmp_path_factory,
        "blurred_images",
        lambda: {seed: make_virtual_image(make_virtual_subject(seed, SHORT)) for seed in SEEDS[:2]},
    )
