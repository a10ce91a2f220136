"""``model.json``: a body model as this program writes it, and reads it as a file that a person gave."""

from __future__ import annotations

import json
from pathlib import Path

from scaling_service.core.errors import FileUnreadable, name_file
from scaling_service.files.tables import read_bytes
from scaling_service.model.body import BodyModel
from scaling_service.model.document import from_document, to_document

SUFFIX = ".json"

_WRITTEN_BY = "scaling, dynamics, consistent and discover write it as model.json"


@name_file
def read_model_json(path: str | Path) -> BodyModel:
    """Read a model as scaling, dynamics, consistent or discovery wrote it.

    Returns exactly the one that was written. Raises FileUnreadable: the file is absent, empty, no JSON, or
    holds something else than a model. Raises InputError: a key is unknown or missing, or a value of the
    wrong kind; its path is the field. Raises ModelRefused: what it describes is no model.
    """
    file = Path(path)
    try:
        content = json.loads(read_bytes(file, "a model.json"))
    except (ValueError, RecursionError):
        raise FileUnreadable(
            "this is not JSON", remedy=f"Give a model of this program: {_WRITTEN_BY}"
        ) from None
    if not isinstance(content, dict) or not {"segments", "coordinates"} <= content.keys():
        # What a document seems to be
        if isinstance(content, dict) and "code_version" in content:
            other = "a document of results"
        elif isinstance(content, dict) and {"subject", "trials"} <= content.keys():
            other = "a subject file"
        else:
            other = "some other document"
        raise FileUnreadable(f"this is {other}, not a model", remedy=f"Give a model: {_WRITTEN_BY}")
    return from_document(content)


def write_model_json(path: Path, model: BodyModel) -> None:
    """Write a model so that :func:`read_model_json` returns it."""
    path.write_text(json.dumps(to_document(model), indent=1, allow_nan=False) + "\n", encoding="utf-8")
