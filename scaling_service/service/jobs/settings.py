"""All that can be chosen for a service."""

from __future__ import annotations

import json
import os
from pathlib import Path

from pydantic import Field, SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict

from scaling_service.service.sandbox.limits import Limits

PREFIX = "SCALING_SERVICE_"
_MB = 1_000_000


class ServiceSettings(BaseSettings):
    """Settings of the service and its runners.

    A variable ``SCALING_SERVICE_WORKERS`` sets ``workers``, and so on; it wins over the file.
    """

    model_config = SettingsConfigDict(env_prefix=PREFIX, extra="forbid", frozen=True)

    data_directory: Path = Field(
        default=Path("scaling-service-data"),
        description="Where everything is kept; only for the service's user.",
    )
    database_url: SecretStr | None = Field(
        default=None, description="PostgreSQL, postgresql://user:password@host/name; else SQLite in the data."
    )
    dask_address: str | None = Field(
        default=None,
        description="Scheduler of a Dask cluster that shares the data directory; else this machine.",
    )
    trusted_network: bool = Field(
        default=False, description="Whether database and cluster may be reached without encryption."
    )
    host: str = Field(
        default="127.0.0.1", min_length=1, description="Address to listen on; others than loopback need keys."
    )
    port: int = Field(default=8000, ge=0, le=65535, description="Port to listen on; 0 takes a free one.")
    tls_certificate: Path | None = Field(default=None, description="PEM file; with tls_key, HTTPS is spoken.")
    tls_key: Path | None = Field(default=None, description="PEM file.")
    request_rate: float = Field(
        default=100.0, gt=0, description="Requests a second of each key or address, in the long run."
    )
    request_burst: int = Field(default=500, ge=1, description="Requests that may come at once before that.")
    workers: int = Field(default=os.cpu_count() or 1, ge=1, le=1024, description="Jobs at the same time.")
    lease_s: float = Field(
        default=30.0, ge=1.0, le=3600.0, description="A runner not heard of for longer is lost."
    )
    most_losses: int = Field(
        default=10, ge=1, le=1000, description="A job that lost so many processes to outside causes fails."
    )
    limit_memory_mb: int = Field(default=4000, ge=100, description="Of each process of a job.")
    limit_cpu_s: float = Field(default=3600.0, ge=1.0, description="Processor time of each process of a job.")
    limit_wall_s: float = Field(default=7200.0, ge=1.0, description="Time of a job.")
    limit_file_mb: int = Field(default=1000, ge=1, description="Each file that a job writes.")
    limit_output_mb: int = Field(default=2000, ge=1, description="All that a job writes.")
    limit_upload_mb: int = Field(default=1000, ge=1, description="Each uploaded file.")
    limit_files: int = Field(default=1000, ge=1, description="Files of a subject.")
    limit_queue: int = Field(default=10_000, ge=1, description="Waiting jobs of an owner.")
    reserve_mb: int = Field(default=500, ge=0, description="No job begins with less room on the disk.")
    retention_days: float | None = Field(
        default=None, gt=0, description="Jobs and subjects older than this are deleted; none unless given."
    )

    @property
    def limits(self) -> Limits:
        """What one job may use."""
        return Limits(
            memory_bytes=self.limit_memory_mb * _MB,
            cpu_s=self.limit_cpu_s,
            wall_s=self.limit_wall_s,
            file_bytes=self.limit_file_mb * _MB,
            output_bytes=self.limit_output_mb * _MB,
        )

    def with_secrets(self) -> str:
        """All settings as JSON for another process of the service; never to be shown or logged."""
        url = self.database_url
        secret = {"database_url": None if url is None else url.get_secret_value()}
        return json.dumps(self.model_dump(mode="json") | secret)
