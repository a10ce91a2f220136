"""Methods are told apart by colour: by those who see all colours and by those who do not, light and dark."""

from __future__ import annotations

import itertools
import json
import re

import numpy as np

from scaling_service.capabilities.shared.names import list_method_names
from scaling_service.core.arrays import Array
from tests.service.page.node import WEB

METHODS = WEB / "src" / "ui" / "methods.json"
PALETTE = METHODS.with_name("palette.ts")
COLOUR = re.compile(r'"(#[\dA-Fa-f]{6})"')
SIGHTS = {
    "all": np.eye(3),
    "protanopia": np.array([[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]]),
    "deuteranopia": np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]]),
}
"""Linear RGB as it is seen: Machado et al. 2009 (IEEE TVCG 15:1291-1298), table 1, severity 1."""

TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
WHITE = TO_XYZ.sum(axis=1)

VISIBLE = 3.0  # of contrast: WCAG 2.2, 1.4.11
PUBLISHED = ("MB_lam", "MB_am", "EB", "EB_am")  # Okabe & Ito's


def test_each_method_has_a_colour_of_its_own() -> None:
    """None is nearer to another than the nearest two of Okabe & Ito's that are shown are to each other."""
    known = {name: read_known()[name] for name in list_method_names()}
    pairs = {two: tell_apart(*(known[name] for name in two)) for two in itertools.combinations(known, 2)}
    nearest = min(far for two, far in pairs.items() if set(two) <= set(PUBLISHED))
    assert [two for two, far in pairs.items() if far < nearest] == []


def test_each_series_is_seen_on_light_and_on_dark() -> None:
    sources = [METHODS, *(WEB / "src" / "results").glob("*.ts")]
    series = {colour for path in sources for colour in COLOUR.findall(path.read_text(encoding="utf-8"))}
    story = (
        PALETTE.read_text(encoding="utf-8").partition("/** Of the story of a search")[2].partition("\n\n")[0]
    )
    series |= set(COLOUR.findall(story))
    for colour in series:
        for paper in ("#ffffff", "#14181d"):
            low, high = sorted(TO_XYZ[1] @ to_linear(one) for one in (colour, paper))
            assert (high + 0.05) / (low + 0.05) >= VISIBLE, (colour, paper)


def tell_apart(one: Array, other: Array) -> float:
    """Distance in CIE 1976 to whoever sees the least of it."""
    return min(float(np.linalg.norm(to_lab(m @ one) - to_lab(m @ other))) for m in SIGHTS.values())


def read_known() -> dict[str, Array]:
    document = json.loads(METHODS.read_text(encoding="utf-8"))
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
