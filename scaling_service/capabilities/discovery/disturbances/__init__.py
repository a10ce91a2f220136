"""Disturbances that no effect of the catalogue has: reported as unexplained, never corrected.

A lens that bends the volume, a camera that trembles: each looks somewhat like several effects at once, and
these would be named in its stead. So such laws are looked for beside the catalogue. A file here holds
``LAWS``, a tuple of :class:`~scaling_service.capabilities.discovery.disturbances.disturbance.DisturbanceLaw`;
a new file is found by itself.
"""

from __future__ import annotations
