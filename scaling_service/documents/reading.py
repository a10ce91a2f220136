"""From the text of a subject document to the document, every error naming file, field and remedy."""

from __future__ import annotations

import json
from collections import abc
from pathlib import Path
from typing import Any, get_args

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from scaling_service.core.errors import FileUnreadable, SubjectInvalid, name_file
from scaling_service.core.text import suggest_name
from scaling_service.documents.subject import SubjectDocument

MAX_BYTES = 1_000_000  # chosen: a subject document has a few kB; beyond this it is some other file

_WANTED = {
    "string_type": ("a text", "Write a text, in quotes if it looks like a number, a date or yes and no"),
    "string_too_short": ("a text", "Write it, or remove the key"),
    "string_too_long": ("a short text", "Shorten it"),
    "string_pattern_mismatch": (
        "a name of letters, digits, spaces, dots, hyphens and underscores",
        "Rename it, for it also names folders",
    ),
    "float_type": ("a number", "Write a number without quotes or unit"),
    "finite_number": ("a finite number", "Write a number, or remove the key"),
    "list_type": ("a list", "Write a list, such as [walk1.c3d, walk2.c3d]"),
    "dict_type": ("a mapping", "Write `key: value` pairs"),
    "model_type": ("a mapping", "Write `key: value` pairs"),
}
"""Kind of a validation error to what is wanted there and the remedy."""


@name_file
def read_document(path: str | Path) -> SubjectDocument:
    """Read and check a subject document.

    ``path``: ``.json`` is read as JSON, anything else as YAML (of which JSON is nearly a part). Raises
    FileUnreadable: it is absent, empty, too large or no text. Raises SubjectInvalid: it does not follow the
    contract.
    """
    return check_document(read_content(path))


@name_file
def read_content(path: str | Path) -> object:
    """What YAML or JSON gives, not checked against any contract; raises as :func:`read_document` does."""
    file = Path(path)
    text = read_text(file)
    return _parse_json(text) if file.suffix.lower() == ".json" else _parse_yaml(text)


def check_document(content: object, *, file: str | Path | None = None) -> SubjectDocument:
    """A subject document from what YAML or JSON gave.

    Raises SubjectInvalid: it does not follow the contract; the first error is shown, with the number of the
    others.

    Examples
    --------
    >>> person = {"id": "S01", "height_m": 1.70}
    >>> trials = {"static": "Static.c3d"}
    >>> check_document({"subject": person, "model": "lower_limb_14dof", "trials": trials}).trials.files
    ('Static.c3d',)
    """
    if not isinstance(content, abc.Mapping):
        raise SubjectInvalid(
            f"a subject document is a mapping of keys, not {_name_kind(content)}",
            file=file,
            field="(top level)",
            remedy="Start with `subject:`, `model:` and `trials:`",
        )
    try:
        return SubjectDocument.model_validate(content)
    except ValidationError as error:
        errors = error.errors(include_url=False)
        # A misspelt key also leaves the right one missing: the misspelling is the one to tell.
        first = min(errors, key=lambda e: e["type"] != "extra_forbidden")
        field, problem, remedy = _explain(first)
        others = len(errors) - 1
        if others:
            problem += f" (and {others} more problem{'s' if others > 1 else ''})"
        raise SubjectInvalid(problem, file=file, field=field, remedy=remedy) from None


@name_file
def read_text(file: Path, kind: str = "a subject file") -> str:
    """The text of a file that people write; FileUnreadable if it is absent, too large or no text."""
    try:
        content = file.read_bytes() if file.stat().st_size <= MAX_BYTES else None
    except FileNotFoundError:
        raise FileUnreadable("there is no such file", remedy="Check the path") from None
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise FileUnreadable(f"it cannot be read: {reason}", remedy="Check the path") from None
    if content is None:
        raise FileUnreadable(f"it is too large for {kind}", remedy="Check the path")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FileUnreadable("it is not UTF-8 text", remedy="Save it as UTF-8 text") from None


class _UniqueKeys(yaml.SafeLoader):
    """YAML in which a key given twice is an error instead of the last one winning."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[abc.Hashable, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.tag != "tag:yaml.org,2002:merge":
                if key.value in seen:
                    raise yaml.constructor.ConstructorError(
                        None, None, f"the key '{key.value}' is given twice", key.start_mark
                    )
                seen.add(key.value)
        return super().construct_mapping(node, deep=deep)


def _parse_yaml(text: str) -> object:
    try:
        return yaml.load(text, Loader=_UniqueKeys)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        raise SubjectInvalid(
            f"it is not valid YAML: {error.problem}",
            field=f"line {mark.line + 1}, column {mark.column + 1}" if mark else None,
            remedy="Correct that line; indent with spaces and put texts with special characters in quotes",
        ) from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        first = str(error).splitlines()[0]
        raise SubjectInvalid(
            f"it is not valid YAML: {first}", field="(whole file)", remedy="Save it as UTF-8 text"
        ) from None


def _parse_json(text: str) -> object:
    def unique(pairs: abc.Sequence[tuple[str, Any]]) -> dict[str, Any]:
        keys = [key for key, _ in pairs]
        for key in keys:
            if keys.count(key) > 1:
                raise SubjectInvalid("the key is given twice", field=key, remedy="Remove one of them")
        return dict(pairs)

    try:
        return json.loads(text, object_pairs_hook=unique)
    except json.JSONDecodeError as error:
        raise SubjectInvalid(
            f"it is not valid JSON: {error.msg}",
            field=f"line {error.lineno}, column {error.colno}",
            remedy="Correct that line",
        ) from None
    except RecursionError:
        raise SubjectInvalid(
            "it is nested too deeply", field="(whole file)", remedy="Check the path"
        ) from None


def _explain(error: ErrorDetails) -> tuple[str, str, str]:
    """Field path, problem and remedy of one validation error."""
    path, kind, value = [str(part) for part in error["loc"] if part != "[key]"], error["type"], error["input"]
    context = error.get("ctx", {})
    if kind == "subject":
        extra = [context["field"]] if context["field"] else []
        return ".".join([*path, *extra]), context["problem"], context["remedy"]
    field = ".".join(path)
    if kind == "extra_forbidden":
        # The mapping in which the unknown key was found, which lists and free keys may lead to
        model: type[BaseModel] = SubjectDocument
        annotation: Any = SubjectDocument
        for part in path[:-1]:
            # An index or a free key names no field: what it holds is sought further in.
            if part in model.model_fields:
                annotation = model.model_fields[part].annotation
            model = next(_list_models(annotation), model)
        known = list(model.model_fields)  # the closest key is told, or all of them
        return (
            field,
            "unknown key",
            (suggest_name(path[-1].lower(), known).strip() or f"Keys here are {', '.join(known)}"),
        )
    if kind == "missing":
        return field, "it is missing", f"Add `{path[-1]}:`"
    if kind == "literal_error":
        return field, f"{value!r} is not possible here", f"Use {context['expected'].replace(chr(39), '')}"
    if kind in _WANTED:
        wanted, remedy = _WANTED[kind]
        return field, f"{wanted} is needed here, not {_name_kind(value)}", remedy
    return field, f"{value!r} is not possible here: {error['msg']}", "Correct it"


def _name_kind(value: object) -> str:
    names = {
        str: "a text",
        bool: "yes or no",
        int: "a number",
        float: "a number",
        list: "a list",
        dict: "a mapping",
    }
    if value is None:
        return "nothing"
    shown = f" ({value!r})" if isinstance(value, str | int | float) and len(repr(value)) < 60 else ""
    return names.get(type(value), f"a {type(value).__name__}") + shown


def _list_models(annotation: Any) -> abc.Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _list_models(inner)
