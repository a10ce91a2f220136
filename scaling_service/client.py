"""A client of the service over HTTP.

Examples
--------
>>> def scaled(url):
...     with Client(url) as client:
...         client.put_subject_file("S01.yaml")      # the document and the files that it names
...         job = client.ask("scalings/optimised", subject="S01", method="MB_am")
...         client.wait(job)
...         return client.result(job)["segment_lengths_mm"]
"""

from __future__ import annotations

import time
import typing
from collections import abc
from pathlib import Path
from urllib.parse import quote

import requests
from pydantic import BaseModel, ValidationError

from scaling_service.core.errors import InputError
from scaling_service.documents import reading, service
from scaling_service.documents.jobs import State

TIMEOUT_S = 60.0
"""Without a byte for so long, the service is taken for gone. Chosen: event streams speak each 15 s."""

_BUSY = (429, 503)
_MOST_WAIT_S = 5.0
_CHUNK_BYTES = 1 << 20

Model = typing.TypeVar("Model", bound=BaseModel)
PageModel = typing.TypeVar("PageModel", service.SubjectPage, service.JobPage)


class ServiceRefused(InputError):
    """The service said no, in the words of its command line."""

    status: int = 0  # the HTTP status


class JobEnded(InputError):
    """A job ended without a result."""


class Client:
    """The service at an address.

    Parameters
    ----------
    url : str
        Such as ``http://127.0.0.1:8000``.
    key : str, optional
        API key; not needed on the service's own machine while it has none.
    patience_s : float
        For so long a service that is busy or away is asked again. All requests may be repeated.
    """

    def __init__(self, url: str, key: str | None = None, *, patience_s: float = 30.0) -> None:
        self._url, self._patience_s = url.rstrip("/"), patience_s
        self._session = requests.Session()
        if key is not None:
            self._session.headers["Authorization"] = f"Bearer {key}"

    def __enter__(self) -> typing.Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the connections back."""
        self._session.close()

    # Subjects

    def put_subject(self, document: abc.Mapping[str, typing.Any]) -> service.SubjectDetail:
        """Give a subject's document."""
        return _parse(service.SubjectDetail, self._call("POST", "/v1/subjects", json=dict(document)))

    def upload(self, subject: str, path: str | Path, name: str | None = None) -> service.FileEntry:
        """Upload a file of a subject, under its own name unless another is given."""
        file = Path(path)
        place = f"{_make_subject_path(subject)}/files/{quote(name or file.name, safe='')}"
        with file.open("rb") as content:
            return _parse(service.FileEntry, self._call("PUT", place, data=content))

    def put_subject_file(self, path: str | Path) -> service.SubjectDetail:
        """Give a subject's document, YAML or JSON, and upload the files beside it that it names."""
        file = Path(path)
        document = reading.read_content(file)
        reading.check_document(document, file=file)
        assert isinstance(document, abc.Mapping)  # or it would have been refused
        subject = self.put_subject(document).id
        for name in sorted(set(_list_possible_file_names(document))):
            if (file.parent / name).is_file():
                self.upload(subject, file.parent / name)
        return self.subject(subject)

    def subject(self, subject: str) -> service.SubjectDetail:
        """One subject."""
        return _parse(service.SubjectDetail, self._call("GET", _make_subject_path(subject)))

    def subjects(self) -> abc.Iterator[service.SubjectSummary]:
        """All subjects, newest first."""
        for page in self._read_pages(service.SubjectPage, "/v1/subjects", {}):
            yield from page.items

    def delete_subject(self, subject: str) -> None:
        """Delete a subject, its files, and all jobs on them, for good."""
        self._call("DELETE", _make_subject_path(subject))

    # The laboratory

    def put_examples(self, persons: int = 1) -> list[str]:
        """Put the built-in example among the subjects, and others like it for a cohort; their names."""
        return _parse(
            service.ExampleList, self._call("POST", "/v1/examples", params={"persons": persons})
        ).subjects

    def vocabulary(self) -> service.Vocabulary:
        """Built-in models with their markers, methods and bones."""
        return _parse(service.Vocabulary, self._call("GET", "/v1/vocabulary"))

    def marker_map(self) -> dict[str, str]:
        """Label to model marker, as the laboratory has them."""
        return _parse(service.MarkerMapDocument, self._call("GET", "/v1/marker-map")).labels

    def put_marker_map(self, labels: abc.Mapping[str, str]) -> None:
        """Keep which label is which marker, in place of what was kept before."""
        self._call("PUT", "/v1/marker-map", json={"labels": dict(labels)})

    # Jobs

    def ask(self, route: str, /, **request: typing.Any) -> service.JobDocument:
        """Ask for a job; one that was done before comes back done.

        The route is such as ``scalings/linear`` or ``comparisons/joint-angles``, the request its body as
        documented at ``/docs``.
        """
        return _parse(service.JobDocument, self._call("POST", f"/v1/{route}", json=request))

    def job(self, job: service.JobDocument | str) -> service.JobDocument:
        """A job as it is now."""
        return _parse(service.JobDocument, self._call("GET", _make_job_path(job)))

    def jobs(self, **chosen: str) -> abc.Iterator[service.JobDocument]:
        """All jobs, newest first; of one ``state``, ``kind`` or ``subject`` where given."""
        for page in self._read_pages(service.JobPage, "/v1/jobs", chosen):
            yield from page.items

    def events(self, job: service.JobDocument | str) -> abc.Iterator[service.JobDocument]:
        """A job each time that it changes, until it is over; connections that break are made again."""
        return (found for found in self._watch(job) if found is not None)

    def wait(self, job: service.JobDocument | str, timeout_s: float = 3600.0) -> service.JobDocument:
        """Wait until a job is done; JobEnded is raised where it failed or was cancelled.

        TimeoutError is raised where it is not over in time; it goes on. The time is looked at whenever the
        service says something, which it does at least each 15 s.
        """
        end = time.monotonic() + timeout_s
        for found in self._watch(job):
            if found is not None and found.state.is_over:
                return _require_done(found)
            if time.monotonic() > end:
                raise TimeoutError(f"the job is not over after {timeout_s:g} s")
        return _require_done(self.job(job))

    def _watch(self, job: service.JobDocument | str) -> abc.Iterator[service.JobDocument | None]:
        """A job each time that it changes, and None where the service only says that it lives."""
        seen = -1
        while True:
            answer = self._answer(
                "GET", f"{_make_job_path(job)}/events", stream=True, headers={"Last-Event-ID": str(seen)}
            )
            with answer:
                for found in _parse_events(answer):
                    yield found
                    if found is not None:
                        seen = found.revision
                        if found.state.is_over:
                            return
            if answer.status_code == 204:
                return

    def result(self, job: service.JobDocument | str) -> dict[str, typing.Any]:
        """What a job found."""
        found: dict[str, typing.Any] = self._call("GET", f"{_make_job_path(job)}/result").json()
        return found

    def files(self, job: service.JobDocument | str) -> list[service.FileEntry]:
        """What a job made."""
        return _parse(service.FileList, self._call("GET", f"{_make_job_path(job)}/files")).items

    def download(self, job: service.JobDocument | str, folder: str | Path) -> list[Path]:
        """Download all that a job made into a folder."""
        written = []
        for file in self.files(job):
            target = (Path(folder) / file.name).resolve()
            if not target.is_relative_to(Path(folder).resolve()):
                problem = f"the service names a file '{file.name}' outside the folder"
                raise InputError(problem, remedy="Do not trust it")
            target.parent.mkdir(parents=True, exist_ok=True)
            with (
                self._answer("GET", f"{_make_job_path(job)}/files/{quote(file.name)}", stream=True) as answer,
                target.open("wb") as content,
            ):
                for chunk in answer.iter_content(_CHUNK_BYTES):
                    content.write(chunk)
            written.append(target)
        return written

    def cancel(self, job: service.JobDocument | str) -> service.JobDocument:
        """Wish that a job ends; one that is over is left as it is."""
        found = self.job(job)
        return (
            found
            if found.state.is_over
            else _parse(service.JobDocument, self._call("DELETE", _make_job_path(job)))
        )

    def delete(self, job: service.JobDocument | str) -> None:
        """Delete a job that is over, with all that it made."""
        if not self.job(job).state.is_over:
            raise InputError(
                "the job is not over", field="job", remedy="Cancel it and wait for its end first"
            )
        self._call("DELETE", _make_job_path(job))

    def _read_pages(
        self, model: type[PageModel], path: str, chosen: abc.Mapping[str, str]
    ) -> abc.Iterator[PageModel]:
        cursor: str | None = ""
        while cursor is not None:
            page = _parse(model, self._call("GET", path, params={**chosen, "cursor": cursor}))
            yield page
            cursor = page.next

    def _call(self, method: str, path: str, **options: typing.Any) -> requests.Response:
        with self._answer(method, path, **options) as answer:
            _ = answer.content
            return answer

    def _answer(self, method: str, path: str, **options: typing.Any) -> requests.Response:
        end = time.monotonic() + self._patience_s
        while True:
            try:
                answer = self._session.request(method, self._url + path, timeout=TIMEOUT_S, **options)
            except requests.ConnectionError as error:
                if time.monotonic() > end:
                    raise InputError(
                        "the service does not answer", field=self._url, remedy="Look whether it runs"
                    ) from error
                wait_s = 0.5
            else:
                if answer.status_code < 400:
                    return answer
                if answer.status_code not in _BUSY or time.monotonic() > end:
                    raise _make_refusal(answer)
                wait_s = float(answer.headers.get("Retry-After", 1))
            if "data" in options:
                options["data"].seek(0)
            time.sleep(min(wait_s, _MOST_WAIT_S))


def _make_refusal(answer: requests.Response) -> ServiceRefused:
    try:
        problem = service.Problem.model_validate_json(answer.content)
    except ValidationError:
        error = ServiceRefused(f"the service answered {answer.status_code}", remedy="Look at its log")
    else:
        error = ServiceRefused(problem.problem, file=problem.file, field=problem.field, remedy=problem.remedy)
    error.status = answer.status_code
    return error


def _parse(model: type[Model], answer: requests.Response) -> Model:
    return model.model_validate_json(answer.content)


def _make_subject_path(name: str) -> str:
    return f"/v1/subjects/{quote(name, safe='')}"


def _make_job_path(job: service.JobDocument | str) -> str:
    return f"/v1/jobs/{job.id if isinstance(job, service.JobDocument) else quote(job, safe='')}"


def _parse_events(answer: requests.Response) -> abc.Iterator[service.JobDocument | None]:
    """The jobs in an event stream, and None for its comments, until it ends or breaks."""
    try:
        for line in answer.iter_lines(chunk_size=1):  # else the last lines wait for more
            if line.startswith(b":"):
                yield None
            elif line.startswith(b"data: {") and line != b"data: {}":
                yield service.JobDocument.model_validate_json(line[6:])
    except (requests.ConnectionError, requests.exceptions.ChunkedEncodingError):
        return


def _require_done(job: service.JobDocument) -> service.JobDocument:
    if job.state is State.DONE:
        return job
    failure = job.failure
    if failure is None:
        raise JobEnded(f"the job is {job.state}", field="job", remedy="Ask for it again")
    raise JobEnded(failure.problem, file=failure.file, field=failure.field, remedy=failure.remedy)


def _list_possible_file_names(content: typing.Any) -> abc.Iterator[str]:
    """All texts among the values of a document that could be names of files."""
    if isinstance(content, str):
        if content and "/" not in content and "\\" not in content and len(content) <= 255:
            yield content
    elif isinstance(content, abc.Mapping | list):
        for value in content.values() if isinstance(content, abc.Mapping) else content:
            yield from _list_possible_file_names(value)
