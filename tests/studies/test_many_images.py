"""As many virtual persons as Puchaud 2019 imaged: no bone is refused. Slow, so only when asked for."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.virtual.example import make_virtual_image, read_image_evidence
from scaling_service.virtual.subject import VirtualSettings, make_virtual_subject

PERSONS = 26


@pytest.mark.benchmark
@pytest.mark.parametrize(("size", "centre_mm", "axis_deg"), [(0.0, 0.5, 0.3), (1.0, 3.0, 4.0)])
def test_nobodys_bones_are_refused(size: float, centre_mm: float, axis_deg: float) -> None:
    settings = VirtualSettings(functional_s=0.1, static_s=0.1, gait_trials=0, image=size)
    centres: dict[str, list[float]] = {}
    axes = []
    for seed in range(PERSONS):
        image = make_virtual_image(make_virtual_subject(seed, settings))
        found = read_image_evidence(image)  # refusals are errors
        assert found.centres.keys() == image.centres.keys(), f"person {seed}: a centre was not found"
        for name, at in image.centres.items():
            centres.setdefault(name[:-2], []).append(
                1e3 * np.linalg.norm(np.subtract(found.centres[name], at))
            )
        axes += [np.arccos(min(1.0, abs(np.dot(found.axes[k], a)))) for k, a in image.axes.items()]
    print({name: f"{np.mean(off):.2f} ({np.max(off):.2f}) mm" for name, off in centres.items()})  # noqa: T201
    print(f"knee axes {np.degrees(np.mean(axes)):.2f} ({np.degrees(np.max(axes)):.2f}) deg")  # noqa: T201
    assert max(np.mean(off) for off in centres.values()) < centre_mm
    assert np.degrees(np.mean(axes)) < axis_deg
