"""Results' tables as files, in the forms that a command was asked for."""

from __future__ import annotations

from collections import abc
from pathlib import Path
from typing import TYPE_CHECKING

from scaling_service.files import result_tables

if TYPE_CHECKING:
    from pydantic import BaseModel

    from scaling_service.core.tables import ResultTable

FOLDER = "tables"

_SOURCE = {"code_version", "subject", "settings", "seed", "input_hashes"}
"""What a table says of where its numbers come from."""


def make_table_writer(
    forms: str | abc.Sequence[str], out: Path
) -> abc.Callable[[abc.Mapping[str, ResultTable], BaseModel], None]:
    """What writes tables under a folder of results; their forms are checked before anything is computed.

    ``forms``: as typed, or each by itself. Raises InputError: one is unknown.
    Raises DependencyMissing: a library is absent.
    """
    chosen = result_tables.check_forms(forms if isinstance(forms, str) else ",".join(forms))

    def write(tables: abc.Mapping[str, ResultTable], document: BaseModel) -> None:
        if chosen:
            about = document.model_dump(mode="json", include=_SOURCE)
            result_tables.save_tables(tables, out / FOLDER, chosen, about)

    return write
