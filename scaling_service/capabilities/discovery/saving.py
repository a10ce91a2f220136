"""What a search found onto disk: complete, or nothing at all."""

from __future__ import annotations

import json
from pathlib import Path

from pydantic import ValidationError

from scaling_service.capabilities.discovery.document import FILE_NAME, DiscoveryDocument
from scaling_service.capabilities.discovery.models import correct_model, make_own_models, write_corrected_osim
from scaling_service.capabilities.discovery.recordings import write_contacts, write_corrected
from scaling_service.capabilities.discovery.report import build_discovery_page
from scaling_service.capabilities.discovery.result import DiscoverResults, make_discovery_document
from scaling_service.core.progress import Progress, show_nothing
from scaling_service.documents.writing import REPORT, all_or_nothing, write_json
from scaling_service.model.body import BodyModel
from scaling_service.model.document import to_document


def save_discovery(
    results: DiscoverResults,
    folder: str | Path,
    *,
    report: bool = True,
    progress: Progress | None = None,
) -> DiscoveryDocument:
    """Write ``discovery.json``, the corrected model and recordings, and the report into a folder.

    Parameters
    ----------
    results : DiscoverResults
        From :func:`discover`.
    folder : path
        Made if it does not exist. What an earlier search wrote there goes; other files stay.
    report : bool
        Whether to write ``report.html``.
    progress : callable, optional
        Called with what is being done and the share that is done, 0 to 1.

    Returns
    -------
    DiscoveryDocument
        What was written as ``discovery.json``: mm, degrees, N and N m.

    Raises
    ------
    InputError
        The folder cannot be made or written to.

    Examples
    --------
    >>> import scaling_service as ss
    >>> found = ss.discover("plates/subject.json", ss.DiscoverSettings(start="none"))
    >>> ss.save_discovery(found, "found", report=False).verdict
    'nothing'
    """
    say = progress or show_nothing
    before = _list_written_before(Path(folder))
    with all_or_nothing(Path(folder)) as scratch:
        say("writing the model", 0.0)
        notes = _write_models(scratch, results)
        say("writing recordings", 0.5)
        notes += write_corrected(scratch, results.after, results.prepared)
        notes += write_contacts(scratch, results.after)
        files = sorted(p.relative_to(scratch).as_posix() for p in scratch.rglob("*") if p.is_file())
        document = make_discovery_document(results, [*files, *([REPORT] if report else [])], notes)
        write_json(scratch / FILE_NAME, document)
        if report:
            say("writing the report", 0.6)
            page = build_discovery_page(results, document)
            (scratch / REPORT).write_text(page.html(), encoding="utf-8")
    for path in before - {Path(folder) / name for name in document.files}:
        path.unlink(missing_ok=True)
    say("done", 1.0)
    return document


def _list_written_before(folder: Path) -> set[Path]:
    """What an earlier search says that it wrote into a folder."""
    try:
        document = DiscoveryDocument.model_validate_json((folder / FILE_NAME).read_bytes())
    except (OSError, ValidationError):
        return set()
    return {
        folder / name for name in document.files if (folder / name).resolve().is_relative_to(folder.resolve())
    }


def _write_models(folder: Path, results: DiscoverResults) -> tuple[str, ...]:
    """``model.json`` and ``model.osim``, and a model for each recording that has something of its own."""
    fit, bones, notes = results.lasting, results.bones, list(results.bones.notes)
    _write_model(folder / "model.json", bones.add_to(correct_model(fit)))
    for trial, model in make_own_models(fit).items():
        _write_model(folder / f"{trial}_model.json", bones.add_to(model))
        notes.append(f"{trial}_model.json holds what was found in {trial} only")
    return (*notes, *write_corrected_osim(folder / "model.osim", fit, results.prepared))


def _write_model(path: Path, model: BodyModel) -> None:
    path.write_text(json.dumps(to_document(model), indent=1, allow_nan=False) + "\n", encoding="utf-8")
