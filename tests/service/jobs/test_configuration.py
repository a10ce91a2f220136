"""Settings: which source wins, what is shown, what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from scaling_service.core.errors import FileUnreadable
from scaling_service.service.jobs.settings import SettingsRefused, load_settings, without_passwords


def test_chosen_wins_over_environment_over_file_over_default(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "settings.yaml"
    file.write_text("workers: 2\nlease_s: 40\nlimit_upload_mb: 7\n")
    monkeypatch.setenv("SCALING_SERVICE_WORKERS", "3")
    monkeypatch.setenv("SCALING_SERVICE_LEASE_S", "50")
    settings = load_settings(file, workers=4)
    assert (settings.workers, settings.lease_s, settings.limit_upload_mb) == (4, 50.0, 7)
    assert settings.limit_files == 1000


def test_limits_are_in_bytes_and_seconds() -> None:
    limits = load_settings(limit_memory_mb=2000, limit_wall_s=60).choose_limits()
    assert (limits.memory_bytes, limits.wall_s) == (2_000_000_000, 60.0)


def test_passwords_are_not_shown() -> None:
    settings = load_settings(database_url="postgresql://user:geheim@localhost/x")
    assert (
        "geheim" not in f"{settings} {settings!r} {without_passwords(settings)} {settings.model_dump_json()}"
    )
    assert without_passwords(settings)["database_url"] == "postgresql://user:***@localhost/x"
    assert "geheim" in settings.with_secrets()


@pytest.mark.parametrize(
    ("values", "field"),
    [
        ({"workers": 0}, "workers"),
        ({"unknown": 1}, "unknown"),
        ({"retention_days": -1}, "retention_days"),
        ({"database_url": "nonsense"}, "database_url"),
        ({"database_url": "postgresql://u:p@db.example.org/x"}, "database_url"),
        ({"database_url": "postgresql://u:p@/x?host=db.example.org"}, "database_url"),
        ({"database_url": "postgresql://u:p@db.example.org/x?sslmode=prefer"}, "database_url"),
        ({"dask_address": "tcp://scheduler.example.org:8786"}, "dask_address"),
    ],
)
def test_what_cannot_be_used_or_is_unsafe_is_refused(values: dict[str, object], field: str) -> None:
    with pytest.raises(SettingsRefused) as caught:
        load_settings(**values)
    assert caught.value.field == field
    assert caught.value.remedy


@pytest.mark.parametrize(
    "values",
    [
        {"database_url": "postgresql://u:p@db.example.org/x?sslmode=verify-full"},
        {"database_url": "postgresql://u:p@127.0.0.1/x"},
        {"database_url": "postgresql://u:p@db.example.org/x", "trusted_network": True},
        {"dask_address": "tls://scheduler.example.org:8786"},
        {"dask_address": "tcp://127.0.0.1:8786"},
    ],
)
def test_what_is_safe_is_taken(values: dict[str, object]) -> None:
    load_settings(**values)


def test_a_data_directory_open_to_others_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    with pytest.raises(SettingsRefused, match="other users"):
        load_settings(data_directory=tmp_path)
    tmp_path.chmod(0o700)
    load_settings(data_directory=tmp_path)


@pytest.mark.parametrize("text", ["- a\n", "a: [\n"])
def test_a_file_that_is_no_settings_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "s.yaml").write_text(text)
    with pytest.raises(FileUnreadable):
        load_settings(tmp_path / "s.yaml")
    with pytest.raises(FileUnreadable):
        load_settings(tmp_path / "absent.yaml")


def test_an_unknown_key_names_the_file(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text("workres: 2\n")
    with pytest.raises(SettingsRefused) as caught:
        load_settings(tmp_path / "s.yaml")
    assert (caught.value.file, caught.value.field) == (str(tmp_path / "s.yaml"), "workres")
