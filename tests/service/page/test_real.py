"""The tour on people who were really recorded: files are dropped as the laboratories left them."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from tests.service.page.conftest import Visit
from tests.service.page.visitor import Visitor

LONGEST_MS = 420_000  # a search of a whole body with forces may take five minutes, and scaling before it
LEFT_OUT = {".json", ".md"}


def bring(visitor: Visitor, folder: Path, name: str) -> None:
    files = sorted(file for file in folder.rglob("*") if file.is_file() and file.suffix not in LEFT_OUT)
    visitor.go()
    visitor.drops(*files)
    visitor.page.get_by_label(f"Whose {len(files)} files are these?").fill(name)
    visitor.press("Check them")


def describe(visitor: Visitor, height_m: str, mass_kg: str) -> None:
    visitor.page.get_by_label("height, m").fill(height_m)
    visitor.page.get_by_label("mass, kg").fill(mass_kg)


def compare(visitor: Visitor) -> set[str]:
    """Names of the files in the zip of a comparison of all methods that there are."""
    visitor.follow("On to the analyses")
    visitor.press("Compare")
    visitor.sees("How far to trust", LONGEST_MS)
    visitor.follow("In space")
    visitor.page.locator(".cursor").wait_for(state="attached", timeout=LONGEST_MS)
    visitor.press("One frame on")
    visitor.follow("Take away")
    with visitor.page.expect_download(timeout=LONGEST_MS) as coming:
        visitor.page.get_by_role("button", name="Everything as one zip").click()
    with zipfile.ZipFile(coming.value.path()) as archive:
        return set(archive.namelist())


def test_files_of_a_laboratory_are_understood(visit: Visit, url: str, shared_data: Path) -> None:
    visitor = visit(url)
    bring(visitor, shared_data / "opencap_squat", "seen")
    visitor.sees("3 recordings in 7 files can be read")
    uses = {
        "static1.trc": "static",
        "squats1.trc": "calibration",
        "squats1_grf.mot": "forces.squats1.trc",
        "unscaled_generic.osim": "model",
    }
    for name, use in uses.items():
        assert visitor.page.get_by_label(f"Use of {name}").input_value() == use
    visitor.press("3 Laboratory")
    visitor.sees("plate 1 up to")
    assert (
        visitor.page.locator("dt", has_text="walking").locator("+ dd").inner_text()
        == "1.7 m, along the arrow"
    )


@pytest.mark.benchmark  # minutes, for the sake of files that differ
@pytest.mark.parametrize(
    ("folder", "height_m", "mass_kg"),
    [
        ("jia_mri", "1.62", "63"),
        ("opencap_squat", "1.68", "62.6"),
        ("functional", "1.75", "70"),
        ("gait2354", "1.80", "72.6"),
        ("clinic/HC031A", "1.33", "27.7"),
    ],
)
def test_a_folder_comes_to_a_verdict_with_height_and_mass_alone(
    visit: Visit, url: str, shared_data: Path, folder: str, height_m: str, mass_kg: str
) -> None:
    visitor = visit(url)
    bring(visitor, shared_data / folder, folder.replace("/", "_"))
    describe(visitor, height_m, mass_kg)
    visitor.follow("On to the analyses")
    visitor.press("Compare")
    visitor.sees("How far to trust", LONGEST_MS)


@pytest.mark.benchmark
def test_walking_with_bones(visit: Visit, url: str, shared_data: Path) -> None:
    visitor = visit(url)
    bring(visitor, shared_data / "jia_mri", "walker")
    visitor.page.get_by_label("Use of manual_model.osim").select_option("")
    visitor.page.get_by_label("model", exact=True).select_option("lower_limb_14dof")
    describe(visitor, "1.62", "63")
    visitor.press("2 Markers")
    visitor.page.get_by_text("Further labels (").click()
    visitor.page.get_by_role("button", name="that move with a segment").click()
    names = compare(visitor)
    assert {"EB/model.json", "EB_am/model.json", "MB_am/model.json", "report.html"} <= names


@pytest.mark.benchmark
def test_squats_with_forces(visit: Visit, url: str, shared_data: Path) -> None:
    visitor = visit(url)
    bring(visitor, shared_data / "opencap_squat", "squatter")
    describe(visitor, "1.68", "62.6")
    assert {"MB/model.osim", "MB_am/model.osim"} <= compare(visitor)
    visitor.follow("Forces")
    visitor.press("Check the forces")
    visitor.sees("Residuals against published limits", LONGEST_MS)
    visitor.follow("squatter")
    visitor.press("Start: Find the missing effect")
    visitor.page.get_by_role("link", name="Search for the missing effect").click()
    visitor.sees("1. Where", LONGEST_MS)
