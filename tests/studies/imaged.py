"""Virtual persons seen in images, for tests of bones and images."""

from __future__ import annotations

from dataclasses import dataclass

from scaling_service.model.trial import ImageEvidence
from scaling_service.virtual.example import VirtualImage, make_virtual_image, read_image_evidence
from scaling_service.virtual.subject import VirtualSettings, VirtualSubject, make_virtual_subject

SHORT = VirtualSettings(functional_s=0.1, static_s=0.1, gait_trials=0)
EXACT = VirtualSettings(functional_s=0.1, static_s=0.1, gait_trials=0, image=0.0)


@dataclass(frozen=True)
class Imaged:
    person: VirtualSubject
    image: VirtualImage
    found: ImageEvidence


def seen(seed: int, settings: VirtualSettings) -> Imaged:
    person = make_virtual_subject(seed, settings)
    image = make_virtual_image(person)
    return Imaged(person, image, read_image_evidence(image))


SEEDS = (1, 4, 10)
"""A man, a small woman, and a man whose femoral necks point far forward (28 degrees)."""
