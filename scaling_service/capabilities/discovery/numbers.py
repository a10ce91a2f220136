"""Numbers of a search as they are shown."""

from __future__ import annotations

import math

from scaling_service.capabilities.discovery.document import QuantityDocument

_NORMAL_95 = 1.96
_SUFFIXES = (
    ("_mm_per_deg", " mm/deg"),
    ("_deg_per_deg", " deg/deg"),
    ("_kgmm", " kg mm"),
    ("_mm", " mm"),
    ("_deg", " deg"),
    ("_Nm", " N m"),
    ("_N", " N"),
    ("_hz", " Hz"),
    ("_s", " s"),
)


def format_figures(value: float | None, count: int = 3) -> str:
    """A number to some figures, a dash where there is none.

    Examples
    --------
    >>> format_figures(0.020134), format_figures(None), format_figures(1234.5)
    ('0.0201', '–', '1.23e+03')
    """
    return "–" if value is None else f"{value:.{count}g}"


def format_chance(p: float | None) -> str:
    """A p-value as shown.

    Examples
    --------
    >>> format_chance(0.3), format_chance(3e-9)
    ('0.30', '< 0.001')
    """
    if p is None or math.isnan(p):
        return "–"
    return "< 0.001" if p < 1e-3 else f"{p:.2f}" if p >= 0.01 else f"{p:.3f}"


def format_percent(probability: float) -> str:
    """A probability as shown.

    Examples
    --------
    >>> format_percent(0.4), format_percent(0.9999), format_percent(1e-9)
    ('40 %', '> 99 %', '< 1 %')
    """
    return "> 99 %" if probability > 0.99 else "< 1 %" if probability < 0.01 else f"{100 * probability:.0f} %"


def format_quantity(name: str, quantity: QuantityDocument, *, spread: bool = False) -> str:
    """A number of an effect with its unit, and its standard deviation where asked for.

    Examples
    --------
    >>> format_quantity("x_mm_per_deg", QuantityDocument(value=0.2013, sd=0.011), spread=True)
    'x 0.201 ± 0.011 mm/deg'
    >>> format_quantity("delay_s", QuantityDocument(value=0.02, sd=None))
    'delay 0.02 s'
    """
    suffix, unit = next(((s, u) for s, u in _SUFFIXES if name.endswith(s)), ("", ""))
    stem = name.removesuffix(suffix).replace("_", " ")
    if name == "kg":
        stem, unit = "", " kg"
    if isinstance(quantity.value, tuple):
        return f"{stem} ({', '.join(f'{v:.2f}' for v in quantity.value)}){unit}"
    if not quantity.determined:
        return f"{stem} not determined".strip()
    sd = quantity.sd if spread else None
    if sd is None or sd <= 0.0:
        return f"{stem} {quantity.value:.3g}{unit}".strip()
    digits = max(0, 1 - math.floor(math.log10(sd)))
    return f"{stem} {quantity.value:.{digits}f} ± {sd:.{digits}f}{unit}".strip()
