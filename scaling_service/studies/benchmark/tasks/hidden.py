"""Effects hidden in a real person's recordings, with forces: what is named, and what else."""

from __future__ import annotations

import dataclasses
import shutil
from collections import abc
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.files import sto, trc
from scaling_service.model.trial import Trial
from scaling_service.studies.benchmark import parts as benchmark_parts
from scaling_service.studies.benchmark.tasks._legs import write_subject

SQUAT, WALK = "squats1", "walking1"
MASS_KG, HEAVIER = 62.6, 1.07
TRUE_OF_THE_PERSON = "body_mass"
"""The plates carry 60.1 kg where 62.6 are declared: that is no false name."""

Change = abc.Callable[[Path], None]


@dataclasses.dataclass(frozen=True, slots=True)
class Hidden:
    """What is hidden, how it is to be named, and its size: the unit's suffix, the value and the tolerance."""

    kind: str
    where: set[str]
    change: Change
    size: tuple[str, float, float] | None = None


def _change_markers(
    names: abc.Sequence[str], change: abc.Callable[[Trial], benchmark_parts.Array], box: Path
) -> None:
    for name in names:
        trial = trc.read_trc(box / f"{name}.trc")
        trc.write_trc(box / f"{name}.trc", dataclasses.replace(trial.trial, markers=change(trial)), "m")


def _exchange(first: str, second: str, trial: Trial) -> benchmark_parts.Array:
    """Two labels for a fifth of the time."""
    markers, n = trial.markers.copy(), trial.n_frames
    pair = [trial.labels.index(first), trial.labels.index(second)]
    rows = slice(int(0.3 * n), int(0.5 * n))
    markers[rows, pair] = trial.markers[rows, pair[::-1]]
    return markers


def _stick(
    name: str, ends: tuple[str, str, str], offset_m: tuple[float, float, float], trial: Trial
) -> benchmark_parts.Array:
    """A marker elsewhere on its segment, which is known by three others that move with it."""
    markers = trial.markers.copy()
    a, b, c = (trial.markers[:, trial.labels.index(end)] for end in ends)
    u = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    w = np.cross(u, c - a)
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    axes = np.stack([u, np.cross(w, u), w], axis=1)
    markers[:, trial.labels.index(name)] += np.einsum("k,nkj->nj", np.array(offset_m), axes)
    return markers


def _change_forces(change: abc.Callable[[sto.Table, benchmark_parts.Array], None], box: Path) -> None:
    for name in (SQUAT, WALK):
        path = box / f"{name}_grf.mot"
        table = sto.read_sto(path)
        data = table.data.copy()
        change(table, data)
        sto.write_sto(path, dataclasses.replace(table, data=data))


def _list_columns(table: sto.Table, plate: int, what: str) -> list[int]:
    """A plate's three columns of one kind (v, p or m), in the order of the file."""
    plain = [name.replace("torque_", "m").replace("moment_", "m") for name in table.columns]
    found = [k for k, name in enumerate(plain) if f"_{what}" in name]
    return found[3 * (plate - 1) : 3 * plate]


def _gain(table: sto.Table, data: benchmark_parts.Array) -> None:
    for what in ("v", "m"):
        data[:, _list_columns(table, 2, what)] *= 1.10


def _shift(table: sto.Table, data: benchmark_parts.Array) -> None:
    loaded = np.abs(data[:, _list_columns(table, 1, "v")[1]]) > 1.0
    data[loaded, _list_columns(table, 1, "p")[2]] += 0.040


def _delay(table: sto.Table, data: benchmark_parts.Array) -> None:
    for column in range(1, data.shape[1]):
        data[:, column] = np.interp(data[:, 0] - 0.040, table.data[:, 0], table.data[:, column])


def _add_bias(table: sto.Table, data: benchmark_parts.Array) -> None:
    """A bias stands while nobody does, too: the plate then pushes where it is trodden on average."""
    up, places = _list_columns(table, 1, "v")[1], _list_columns(table, 1, "p")
    empty = np.abs(data[:, up]) <= 1.0
    for place in places:
        data[empty, place] = data[~empty, place].mean()
    data[:, up] += 60.0


def _lean(box: Path) -> None:
    """Cameras and plates were levelled alike, three degrees off."""
    turn = Rotation.from_euler("x", 3.0, degrees=True).as_matrix()
    _change_markers((SQUAT, WALK), lambda trial: trial.markers @ turn.T, box)

    def lean(table: sto.Table, data: benchmark_parts.Array) -> None:
        plates = sum("_v" in name for name in table.columns) // 3
        for plate in range(1, plates + 1):
            for what in ("v", "p", "m"):
                columns = _list_columns(table, plate, what)
                data[:, columns] = data[:, columns] @ turn.T

    _change_forces(lean, box)


def _restick_thigh(trials: tuple[str, ...], offset_m: tuple[float, float, float], within_mm: float) -> Hidden:
    """A marker of the left thigh is stuck on elsewhere in some of the recordings."""
    ends = ("L_thigh1", "L_thigh2", "L_thigh4")
    change = partial(_change_markers, trials, partial(_stick, "L_thigh3", ends, offset_m))
    size = ("_mm", round(1e3 * float(np.linalg.norm(offset_m)), 1), within_mm)
    return Hidden("marker_offset", {"L_thigh3"}, change, size)


def list_hidden() -> abc.Mapping[str, Hidden | None]:
    """What is hidden in the recordings, by name; nothing in the first."""
    swapped, both = ("r_sh2", "r_shank_antsup"), (SQUAT, WALK)
    swap = partial(_change_markers, (SQUAT,), partial(_exchange, *swapped))
    grow = partial(_change_markers, both, lambda trial: 1.05 * trial.markers)
    gain, shift, delay, bias = (partial(_change_forces, f) for f in (_gain, _shift, _delay, _add_bias))
    return {
        "ordinary": None,
        "swap": Hidden("marker_swap", {*swapped}, swap),
        "moved": _restick_thigh((WALK,), (0.025, 0.015, 0.0), 8.0),
        "mass": Hidden("body_mass", {"world"}, lambda _box: None, ("factor", 0.960 / HEAVIER, 0.015)),
        "gain": Hidden("plate_gain", {"plate_2"}, gain, ("factor", 1.10, 0.03)),
        "plate": Hidden("plate_position", {"plate_1"}, shift, ("_mm", 40.0, 12.0)),
        "late": Hidden("force_delay", {"forces"}, delay, ("_s", 0.040, 0.010)),
        "bias": Hidden("plate_bias", {"plate_1"}, bias, ("_N", 60.0, 15.0)),
        "lean": Hidden("gravity_tilt", {"world"}, _lean, ("_deg", 3.0, 1.0)),
        "moved_always": _restick_thigh(both, (0.030, 0.025, 0.0), 10.0),
        "volume": Hidden("capture_scale", {"markers"}, grow, ("factor", 1.05, 0.015)),
    }


def make_cases(data: Path, folder: Path, _seed: int) -> abc.Sequence[benchmark_parts.Case]:
    """Squats to fit and a walk held out, as recorded and with one thing hidden in them."""
    cases = []
    for name, hidden in list_hidden().items():
        box = folder / name
        box.mkdir(parents=True, exist_ok=True)
        for trial in (SQUAT, WALK):
            for file in (f"{trial}.trc", f"{trial}_grf.mot"):
                shutil.copyfile(data / "opencap_squat" / file, box / file)
        shutil.copyfile(data / "opencap_squat" / "manually_scaled.osim", box / "model.osim")
        if hidden is not None:
            hidden.change(box)
        mass = MASS_KG * (HEAVIER if name == "mass" else 1.0)
        document = {
            "subject": {"id": "squat", "sex": "F", "height_m": 1.68, "mass_kg": mass},
            "model": "model.osim",
            "trials": {"calibration": [f"{SQUAT}.trc"], "evaluation": [f"{WALK}.trc"]},
            "forces": {f"{t}.trc": f"{t}_grf.mot" for t in (SQUAT, WALK)},
        }
        write_subject(box, document)
        cases.append(
            benchmark_parts.Case(name=name, judge=partial(judge_names, hidden), ours=partial(search, box))
        )
    return cases


def search(box: Path, answer: Path, run: benchmark_parts.Run) -> None:
    """Our search, with the model as it is."""
    written = run(["discover", box / "subject.yaml", "--start", "none", "--no-report"])
    (written / "discovery.json").replace(answer / "discovery.json")


def judge_names(hidden: Hidden | None, answer: Path, _opensim: Path) -> abc.Mapping[str, float]:
    """Right: it is named at its place and in its size; in ordinary recordings: nothing but the mass is."""
    effects = [
        e
        for e in benchmark_parts.read_answer(answer, "discovery.json").get("effects", [])
        if e.get("carries", True)
    ]
    own = [
        e for e in effects if hidden is not None and e["kind"] == hidden.kind and hidden.where & {*e["where"]}
    ]
    others = [e for e in effects if e not in own and e["kind"] != TRUE_OF_THE_PERSON]
    right = not others if hidden is None else any(_has_size(e, hidden) for e in own)
    return {"wrong": 0.0 if right else 100.0, "others": float(len(others))}


def _has_size(effect: abc.Mapping[str, abc.Mapping[str, abc.Mapping[str, float]]], hidden: Hidden) -> bool:
    if hidden.size is None:
        return True
    suffix, value, within = hidden.size
    parts = [p["value"] for key, p in effect["parameters"].items() if key.endswith(suffix)]
    found = parts[0] if suffix == "factor" and parts else float(np.linalg.norm(parts))
    return abs(found - value) <= within
