"""Methods are told apart by colour: by those who see all colours and by those who do not, light and dark."""

from __future__ import annotations

import itertools
import json

import numpy as np

from scaling_service.capabilities.shared.names import list_method_names
from scaling_service.core.arrays import Array
from tests.service.page.node import WEB

SIGHTS = {
    "all": np.eye(3),
    "protanopia": np.array([[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]]),
    "deuteranopia": np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]]),
}
"""Linear RGB as it is seen: Machado et al. 2009 (IEEE TVCG 15:1291-1298), table 1, severity 1."""

TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
WHITE = TO_XYZ.sum(axis=1)

VISIBLE = 2.0  # chosen: of contrast; Okabe & Ito's orange has 2.3 on white, and lines differ in dashes, too


def test_each_method_has_a_colour_of_its_own() -> None:
    """MAP's is further from Okabe & Ito's, which the other five are, than the nearest two of those apart."""
    known = read_known()
    assert set(list_method_names()) <= set(known)
    published = [known[name] for name in list_method_names() if name != "MAP"]
    nearest = min(tell_apart(one, other) for one, other in itertools.combinations(published, 2))
    assert min(tell_apart(known["MAP"], other) for other in published) > nearest


def test_each_is_seen_on_light_and_on_dark() -> None:
    known = read_known()
    for name in list_method_names():
        for paper in ("#ffffff", "#14181d"):
            low, high = sorted(TO_XYZ[1] @ colour for colour in (known[name], to_linear(paper)))
            assert (high + 0.05) / (low + 0.05) > VISIBLE, (name, paper)


def tell_apart(one: Array, other: Array) -> float:
    """Distance in CIE 1976 to whoever sees the least of it."""
    return min(float(np.linalg.norm(to_lab(m @ one) - to_lab(m @ other))) for m in SIGHTS.values())


def read_known() -> dict[str, Array]:
    document = json.loads((WEB / "src" / "ui" / "methods.json").read_text(encoding="utf-8"))
    return {name: to_linear(style["colour"]) for name, style in document["known"].items()}


def to_linear(colour: str) -> Array:
    share = np.array([int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)])
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def to_lab(linear: Array) -> Array:
    x, y, z = np.cbrt(TO_XYZ @ np.clip(linear, 0.0, 1.0) / WHITE)
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


def test_each_method_is_explained() -> None:
    text = (WEB / "src" / "ui" / "glossary.ts").read_text(encoding="utf-8")
    assert [name for name in list_method_names() if f'  {name}: "' not in text] == []
