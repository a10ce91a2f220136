"""``report.html``: the page's own views of a result with the result inside, one file that needs nothing else.

Without JavaScript it shows the :class:`~scaling_service.report.summary.Summary`. A content security policy
forbids it to load or send anything, and lets no script run but the bundle's, whatever text comes from files.
"""

from __future__ import annotations

import base64
import dataclasses
import gzip
import hashlib
import json
import tempfile
from collections import abc
from functools import lru_cache
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from pydantic import BaseModel

from scaling_service.documents.writing import REPORT, code_version
from scaling_service.report.summary import Summary

BUNDLE = Path(__file__).parents[1] / "service" / "page" / "built" / "report"
"""What the page's build makes for reports: ``report.js``, ``style.css``, ``licences.txt``."""

_WITHOUT_SCRIPTS = (
    "This is the summary. With JavaScript this file also shows figures, all tables and the models in space; "
    "nothing is loaded from elsewhere. All numbers are in {name}, too."
)
_WITHOUT_BUNDLE = (
    "This is the summary only: this installation was built without the web page, whose views a report shows. "
    "All numbers are in {name}."
)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A result and what its views show.

    ``kind``: names the view, as kinds of jobs do.
    ``name``: of the document's file beside the report.
    ``files``: name to content of what the views ask for, as among a job's files.
    ``beside``: names of further files beside the report.
    ``vocabulary``: what the views need of the service's words.
    """

    kind: str
    name: str
    summary: Summary
    document: BaseModel
    files: abc.Mapping[str, bytes] = dataclasses.field(default_factory=dict)
    beside: abc.Sequence[str] = ()
    vocabulary: abc.Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def html(self) -> str:
        """The whole file; the summary alone where the page was not built."""
        script, style, licences = (_read_part(name) for name in ("report.js", "style.css", "licences.txt"))
        lacking = (_WITHOUT_SCRIPTS if script else _WITHOUT_BUNDLE).format(name=self.name)
        said = f'<p class="note">{escape(lacking)}</p>'
        note = f"<noscript>{said}</noscript>" if script else said
        views = f"{self._write_data()}<script>{script}</script>" if script else ""
        if licences:
            title = "Licences of what this file is made of"
            licences = f"<details><summary>{title}</summary><pre>{escape(licences)}</pre></details>"
        # Nothing from elsewhere, and only this script
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        return Template(Path(__file__).with_name("report.html").read_text(encoding="utf-8")).substitute(
            scripts=f"'sha256-{digest}'" if script else "'none'",
            title=escape(self.summary.title),
            style=style,  # in an element that plotly would write its own styles into, unless it says not to
            summary=self.summary.html(),
            note=note,
            version=escape(f"scaling-service {code_version()}"),
            name=escape(self.name),
            licences=licences,
            views=views,
        )

    def write(self, folder: Path) -> None:
        """The file ``report.html`` in a folder."""
        (folder / REPORT).write_text(self.html(), encoding="utf-8")

    def _write_data(self) -> str:
        """All that the views show, as JSON that no browser executes."""
        held = {
            "kind": self.kind,
            "title": self.summary.title,
            "subtitle": self.summary.subtitle,
            "name": self.name,
            "document": self.document.model_dump(mode="json"),
            "files": {
                name: base64.b64encode(gzip.compress(content, 6, mtime=0)).decode()
                for name, content in self.files.items()
            },
            "beside": [self.name, *self.beside],
            "vocabulary": dict(self.vocabulary),
            "summary": self.summary.describe(),
        }
        text = json.dumps(held, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        # no text can end the element
        return f'<script type="application/json" id="held">{text.replace("<", chr(92) + "u003c")}</script>'


def collect_files(write: abc.Callable[[Path], object]) -> dict[str, bytes]:
    """All that is written into a folder of its own, by names relative to it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(folder)
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


@lru_cache(maxsize=8)
def _read_part(name: str) -> str:
    """A part of the bundle; empty where the page was not built."""
    file = BUNDLE / name
    return file.read_text(encoding="utf-8") if file.is_file() else ""
