"""Results as tables: CSV with a JSON beside it, Parquet, and motions under Motion-BIDS' names."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from scaling_service.core import errors
from scaling_service.core.tables import MotionTable, ResultTable

UNITS: Mapping[str, str] = MappingProxyType(
    {"mm": "mm", "m": "m", "s": "s", "deg": "deg", "rad": "rad", "N": "N", "Nm": "N m", "kg": "kg"}
)
"""End of a column's name to its unit."""

BIDS_VERSION = "1.9.0"
"""Of the Brain Imaging Data Structure: the first with motion (Jeung et al. 2024, Sci Data 11:716)."""

FORMS = ("csv", "parquet", "bids")

_NOT_A_LABEL = re.compile(r"[^0-9A-Za-z]+")
_SD = "_sd_"
_CURVE = "deg_at_"  # a mean curve's angle at a share of the stride

About = Mapping[str, Any]
"""Where the numbers come from, as JSON: code version, settings, seed, hashes of the inputs."""


def find_unit(column: str) -> str | None:
    """The unit that a column's name ends in.

    Examples
    --------
    >>> find_unit("knee_angle_r_deg"), find_unit("method")
    ('deg', None)
    """
    if column.startswith(_CURVE):
        return _CURVE.partition("_")[0]
    return UNITS.get(column.rpartition("_")[2]) if "_" in column else None


def check_forms(text: str) -> tuple[str, ...]:
    """The forms that a comma-separated text names.

    Raises InputError: one is unknown. Raises DependencyMissing: pyarrow is not installed, and is needed.
    """
    forms = tuple(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))
    for form in forms:
        if form not in FORMS:
            raise errors.InputError(
                f"there are no tables as '{form}'", field="--tables", remedy=f"There are {', '.join(FORMS)}"
            )
    if "parquet" in forms and find_spec("pyarrow") is None:
        raise errors.DependencyMissing(
            "Parquet is written by pyarrow, which is not installed",
            field="--tables",
            remedy="Install it with `pip install scaling-service[tables]`, or take csv",
        )
    return forms


def save_tables(tables: Mapping[str, ResultTable], folder: Path, forms: Sequence[str], about: About) -> None:
    """Write tables by name into a folder, which is made.

    Raises InputError: the folder cannot be made or written to.
    """
    writers = {"csv": write_csv, "parquet": write_parquet, "bids": write_motion_bids}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for form in forms:
            writers[form](tables, folder, about)
    except OSError as error:
        raise errors.InputError(
            f"tables cannot be written there: {error.strerror}",
            file=folder,
            field="--out",
            remedy="Name a folder that can be written to",
        ) from None


def describe_table(table: ResultTable, about: About) -> dict[str, Any]:
    """What is to be known of a table beside its numbers, as JSON."""
    columns = {name: {"unit": find_unit(name)} for name in table.columns}
    return {"title": table.title, "columns": columns, "source": dict(about)}


def write_csv(tables: Mapping[str, ResultTable], folder: Path, about: About) -> None:
    """``NAME.csv``, empty where not known, and ``NAME.json`` with title, units and source."""
    for name, table in tables.items():
        with (folder / f"{name}.csv").open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(table.columns)
            writer.writerows(
                ["" if isinstance(value, float) and math.isnan(value) else value for value in row]
                for row in table.rows
            )
        _write_json(folder / f"{name}.json", describe_table(table, about))


def write_parquet(tables: Mapping[str, ResultTable], folder: Path, about: About) -> None:
    """``NAME.parquet``; every field's metadata has its ``unit``, the schema's ``title`` and ``source``."""
    import pyarrow
    from pyarrow import parquet

    for name, table in tables.items():
        columns = zip(*table.rows, strict=True) if table.rows else [()] * len(table.columns)
        arrays = [pyarrow.array(list(values)) for values in columns]
        fields = [
            pyarrow.field(
                column, array.type, metadata={"unit": unit} if (unit := find_unit(column)) else None
            )
            for column, array in zip(table.columns, arrays, strict=True)
        ]
        metadata = {"title": table.title, "source": json.dumps(dict(about))}
        schema = pyarrow.schema(fields, metadata=metadata)
        parquet.write_table(pyarrow.Table.from_arrays(arrays, schema=schema), folder / f"{name}.parquet")


def write_motion_bids(tables: Mapping[str, ResultTable], folder: Path, about: About) -> None:
    """Every motion as ``bids/sub-S/motion/sub-S_task-TRIAL_tracksys-SYSTEM_motion.tsv`` with its channels.

    A dataset of the Brain Imaging Data Structure: ``motion.tsv`` has no header and no time, ``channels.tsv``
    names its columns. Turns are of type JNTANG, translations POS, standard deviations MISC.
    """
    root = folder / "bids"
    subject = f"sub-{_make_label(str(about.get('subject', 'unknown')))}"
    place = root / subject / "motion"
    motions = [table for table in tables.values() if isinstance(table, MotionTable)]
    if not motions:
        return
    place.mkdir(parents=True, exist_ok=True)
    name = {"Name": "Motions by scaling-service", "BIDSVersion": BIDS_VERSION, "DatasetType": "raw"}
    generated = [{"Name": "scaling-service", "Version": str(about.get("code_version", ""))}]
    _write_json(root / "dataset_description.json", {**name, "GeneratedBy": generated})
    (root / "README").write_text("Coordinates of a body model in degrees and metres.\n", encoding="utf-8")
    (root / "participants.tsv").write_text(f"participant_id\n{subject}\n", encoding="utf-8")
    for table in motions:
        task, system = _make_label(table.trial), _make_label(table.system)
        stem = f"{subject}_task-{task}_tracksys-{system}"
        values = np.array(table.rows, dtype=float)
        rows = (["n/a" if not math.isfinite(v) else f"{v:.10g}" for v in row[1:]] for row in values)
        _write_tsv(place / f"{stem}_motion.tsv", rows)
        channels = []
        for column in table.columns[1:]:
            # A row of `channels.tsv`; a coordinate is the point that it moves.
            known, _, end = column.rpartition("_")
            moved = known.removesuffix("_sd")
            kind = "MISC" if _SD in column else "JNTANG" if UNITS[end] == "deg" else "POS"
            component = moved[-1] if kind == "POS" and moved[-1] in "xyz" else "n/a"
            channels.append([known, component, kind, moved, UNITS[end]])
        head = ["name", "component", "type", "tracked_point", "units"]
        _write_tsv(place / f"{stem}_channels.tsv", [head, *channels])
        counts = {
            f"{kind}ChannelCount": sum(channel[2] == kind for channel in channels)
            for kind in ("JNTANG", "POS", "MISC")
        }
        # Frames a second; of a single frame there is none, which is written as 0.
        times = values[:, 0]
        sidecar = {
            "TaskName": table.trial,
            "SamplingFrequency": (
                float(round((len(times) - 1) / (times[-1] - times[0]), 6)) if len(times) > 1 else 0.0
            ),
            "TrackingSystemName": table.system,
            "MotionChannelCount": len(channels),
            "MissingValues": "n/a",
            **counts,
        }
        _write_json(place / f"{stem}_motion.json", sidecar)


def _make_label(text: str) -> str:
    """A label of BIDS holds letters and digits only."""
    return _NOT_A_LABEL.sub("", text) or "unknown"


def _write_tsv(path: Path, rows: Any) -> None:
    path.write_text("".join("\t".join(row) + "\n" for row in rows), encoding="utf-8")


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
