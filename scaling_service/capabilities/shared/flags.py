"""Commands from options: an options model becomes flags, and the arguments that several commands share."""

from __future__ import annotations

import functools
import inspect
import typing
from collections import abc
from dataclasses import dataclass
from pathlib import Path

import annotated_types
import typer
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from scaling_service.core import options
from scaling_service.core.errors import InputError

# Whether a path can be read is asked where it is read, with file and remedy in the answer.
SubjectFile = typing.Annotated[
    Path,
    typer.Argument(metavar="SUBJECT", help="Subject file, YAML or JSON.", show_default=False, readable=False),
]


def make_folder_parser(option: str) -> abc.Callable[[str], Path]:
    """The parser of an option that names a folder; an empty text, as of an unset shell variable, is none."""

    def parse(text: str) -> Path:
        if not text.strip():
            raise InputError("no folder is given", field=option, remedy="Name a folder")
        return Path(text)

    return parse


Out = typing.Annotated[
    Path,
    typer.Option(
        "--out",
        "-o",
        metavar="DIR",
        help="Folder for the results.",
        show_default=False,
        parser=make_folder_parser("--out"),
    ),
]
Tables = typing.Annotated[
    str,
    typer.Option(
        metavar="FORMAT,…",
        help="Tables of the results under tables/, with units and source: csv, parquet, "
        "bids (motions under Motion-BIDS' names).",
        show_default=False,
    ),
]
Report = typing.Annotated[bool, typer.Option("--report/--no-report", help="Whether to write report.html.")]
Workers = typing.Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Subjects at a time; unless given, one per processor core."),
]


class Only:
    """Beside an options model in a command's signature: the flags that this command has."""

    def __init__(self, *names: str) -> None:
        self.names = names  # of fields, wherever in the model they are


@dataclass(frozen=True, slots=True)
class _Field:
    """A flagged field: where it is in the model, and how it is shown."""

    path: tuple[str, ...]
    info: FieldInfo
    flag: options.Flag

    @property
    def parameter(self) -> str:
        """The flag as a name in Python."""
        return self.option.removeprefix("--").replace("-", "_")

    @property
    def option(self) -> str:
        """The flag as it is typed."""
        return self.flag.name or f"--{self.path[-1].replace('_', '-')}"

    def signature(self, default: options.Options) -> inspect.Parameter:
        """The parameter that typer makes an option of."""
        value = functools.reduce(getattr, self.path, default)
        bounds: dict[str, typing.Any] = {} if self.flag.least is None else {"min": self.flag.least}
        for constraint in self.info.metadata:
            if isinstance(constraint, annotated_types.Ge):
                bounds["min"] = constraint.ge
            if isinstance(constraint, annotated_types.Le):
                most = constraint.le
                if isinstance(most, int | float) and most < options.LARGEST:
                    bounds["max"] = most
        option = typer.Option(
            self.option,
            help=self.flag.help or self.info.description,
            metavar=self.flag.metavar,
            rich_help_panel=self.flag.panel,
            **bounds,
        )
        return inspect.Parameter(
            self.parameter,
            inspect.Parameter.KEYWORD_ONLY,
            default=None if self.flag.read is not None else value,
            annotation=typing.Annotated[self.flag.kind or self.info.annotation, option],
        )


def with_flags(function: abc.Callable[..., typing.Any]) -> abc.Callable[..., typing.Any]:
    """The function as a command: it is called with models made of the flags that were given.

    A parameter's default, where its annotation is an options model, holds the defaults of its flags. The
    command raises InputError where a value is outside of what the model allows.
    """
    models: dict[str, tuple[options.Options, list[_Field]]] = {}
    shown: list[inspect.Parameter] = []
    for parameter in inspect.signature(function, eval_str=True).parameters.values():
        model, only = _find_options(parameter.annotation)
        if model is None:
            shown.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
            continue
        default = model() if parameter.default is inspect.Parameter.empty else parameter.default
        fields = [f for f in _list_flagged(model) if only is None or f.path[-1] in only.names]
        models[parameter.name] = (default, fields)
        shown.extend(field.signature(default) for field in fields)

    @functools.wraps(function)
    def command(**given: typing.Any) -> typing.Any:
        made = {
            name: _fill(default, [(f, given.pop(f.parameter)) for f in fields])
            for name, (default, fields) in models.items()
        }
        return function(**given, **made)

    command.__signature__ = inspect.Signature(shown)  # type: ignore[attr-defined]
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in shown}
    return command


def read_labels(given: list[str]) -> abc.Mapping[str, str]:
    """The reader of ``--marker``, which takes ``MARKER=LABEL`` and may be given again."""
    found: dict[str, str] = {}
    for text in given:
        name, sign, value = (part.strip() for part in text.partition("="))
        if not (name and sign and value) or name in found:
            problem = f"'{name}' is mapped twice" if name in found else f"'{text}' is not MARKER=LABEL"
            raise InputError(problem, field="--marker", remedy="Give it like --marker RLFE=RKNE")
        found[name] = value
    return found


def read_names(text: str) -> list[str]:
    """The reader of a flag that takes names with commas between."""
    return [name.strip() for name in text.split(",")]


def _find_options(annotation: typing.Any) -> tuple[type[options.Options] | None, Only | None]:
    """The model, where the annotation is one, and which of its flags count."""
    if typing.get_origin(annotation) is typing.Annotated:
        kind, *extra = typing.get_args(annotation)
        model, _ = _find_options(kind)
        return model, next((e for e in extra if isinstance(e, Only)), None)
    if isinstance(annotation, type) and issubclass(annotation, options.Options):
        return annotation, None
    return None, None


def _list_flagged(model: type[options.Options], above: tuple[str, ...] = ()) -> abc.Iterator[_Field]:
    for name, info in model.model_fields.items():
        flag = next((m for m in info.metadata if isinstance(m, options.Flag)), None)
        if flag is not None:
            yield _Field((*above, name), info, flag)
        elif isinstance(info.annotation, type) and issubclass(info.annotation, options.Options):
            yield from _list_flagged(info.annotation, (*above, name))


def _fill(default: options.Options, given: list[tuple[_Field, typing.Any]]) -> options.Options:
    """The model with what was given in place of its defaults."""
    values = default.model_dump()
    for field, value in given:
        if field.flag.read is not None and value is None:
            continue
        inner = functools.reduce(dict.__getitem__, field.path[:-1], values)
        inner[field.path[-1]] = value if field.flag.read is None else field.flag.read(value)
    try:
        return type(default).model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        names_of = {f.path: f.option for f, _ in given}
        option = names_of.get(tuple(str(part) for part in first["loc"]), ".".join(map(str, first["loc"])))
        problem = first["msg"].removeprefix("Value error, ")
        raise InputError(problem, field=option, remedy="See --help") from None
