"""YAML to typed, frozen configs. Every mistake is told at once, with file:line, key, rule and remedy."""

import difflib
import json
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    TypeAdapter,
    ValidationError,
    model_serializer,
    model_validator,
)
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError

_LARGEST_CONFIG_BYTES = 1 << 20


@dataclass(frozen=True)
class Introduced:
    """Marks a field that came after configs were first stored: ``new: Annotated[bool, Introduced(False)] = False``.

    value: what everything made before does, in plain values as `model_dump(mode="json")` gives them. It stays for
    ever, while the default of the field may change: a config of that value keeps its identity from before the field
    was there, and a stored config without the field has it.
    """

    value: Any


class Config(BaseModel):
    """Base of every config model: frozen, no unknown keys, no silent conversions."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    def identity(self) -> dict[str, Any]:
        """Plain values that say which config this is; the one source of folder hashes and comparisons.

        The dump, less every field, however deep, that still has the value it was `Introduced` with.
        """
        return self.model_dump(mode="json", context=_IDENTITY)

    @model_serializer(mode="wrap")
    def _without_what_was_introduced(self, dump: Callable[[Any], Any], info: Any) -> Any:
        values = dump(self)
        if info.context is _IDENTITY:
            for name, mark in _introduced(type(self)):
                if name in values and values[name] == mark.value:
                    del values[name]
        return values

    @model_validator(mode="after")
    def _as_it_was_stored(self, info: Any) -> "Config":
        if (info.context or {}).get("stored"):
            for name, mark in _introduced(type(self)):
                if name not in self.model_fields_set:
                    annotation: Any = type(self).model_fields[name].annotation
                    plain = json.dumps(mark.value)
                    self.__dict__[name] = TypeAdapter(annotation).validate_json(plain, context=info.context)
        return self


_IDENTITY = {"identity": True}


def _introduced(model: type[BaseModel]) -> list[tuple[str, Introduced]]:
    return [
        (name, mark)
        for name, field in model.model_fields.items()
        for mark in field.metadata
        if isinstance(mark, Introduced)
    ]


class ConfigError(ValueError):
    """A config that does not fit; its message lists every mistake on a line of its own."""


Model = TypeVar("Model", bound=Config)

Identity = dict[str, Any]
"""What `Config.identity` gives: carried and compared by all, read by none but the room whose config it is of."""

STORED = {"stored": True}
"""Validation context of what this project wrote earlier: a field that is missing there is as it was `Introduced`."""


def load_config(model: type[Model], path: Path, overrides: Sequence[str] = (), *, stored: bool = False) -> Model:
    """Read `path` as YAML 1.2, apply `overrides` (``a.b=value``) and check the whole against `model`.

    stored: written by `dump_config`, so that a field that it lacks was not yet there and is as it was `Introduced`.
    Raises ConfigError listing every mistake as ``file:line: key: rule``; FileNotFoundError if there
    is no such file.
    """
    if path.stat().st_size > _LARGEST_CONFIG_BYTES:
        raise ConfigError(f"{path}: larger than {_LARGEST_CONFIG_BYTES} bytes; this is no config file")
    tree = _parse(path.read_text(encoding="utf-8"), str(path))
    if not isinstance(tree, CommentedMap):
        raise ConfigError(f"{path}: a config is a mapping of keys, got {type(tree).__name__}")
    origins: dict[tuple[str, ...], str] = {}
    problems = [problem for text in overrides if (problem := _override(tree, text, origins))]
    if problems:
        raise ConfigError("\n".join(problems))
    return _validate(model, tree, source=str(path), origins=origins, folder=path.parent, stored=stored)


def parse_config(model: type[Model], values: Mapping[str, Any], *, source: str, stored: bool = False) -> Model:
    """Check plain values against `model`. stored: such as a config kept inside a card, as `load_config` says.

    Raises ConfigError; `source` names where the values came from.
    """
    return _validate(model, values, source=source, origins={}, stored=stored)


def dump_config(config: Config) -> str:
    """The config as YAML text that `load_config` reads back to an equal config."""
    from io import StringIO

    yaml, text = YAML(), StringIO()
    yaml.dump(config.model_dump(mode="json"), text)
    return text.getvalue()


def _parse(text: str, source: str) -> Any:
    try:
        return YAML(typ="rt").load(text)
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        problem = (error.problem or "not valid YAML").strip()
        raise ConfigError(f"{source}:{line}: {problem}") from error
    except YAMLError as error:
        raise ConfigError(f"{source}: not valid YAML: {error}") from error


def _override(tree: CommentedMap, text: str, origins: dict[tuple[str, ...], str]) -> str | None:
    """Set one ``a.b=value`` in the tree; returns what is wrong with it, if anything."""
    key, equals, value = text.partition("=")
    parts = tuple(key.strip().split("."))
    if not equals or not all(parts):
        return f"command line: {text!r} is not of the form key.subkey=value"
    node: Any = tree
    for part in parts[:-1]:
        child = _child(node, part)
        if child is None and isinstance(node, CommentedMap):
            child = node[part] = CommentedMap()
        node = child
    if isinstance(node, CommentedMap):
        node[parts[-1]] = _parse(value, f"command line: {text}")
    elif isinstance(node, CommentedSeq) and parts[-1].isdigit() and int(parts[-1]) < len(node):
        node[int(parts[-1])] = _parse(value, f"command line: {text}")
    else:
        return f"command line: {text!r}: there is no section {'.'.join(parts[:-1])!r} to set it in"
    origins[parts] = f"command line: {text}"
    return None


def _child(node: Any, part: str) -> Any:
    if isinstance(node, Mapping):
        return node.get(part)
    if isinstance(node, Sequence) and not isinstance(node, str) and part.isdigit():
        return node[int(part)] if int(part) < len(node) else None
    return None


def _validate(
    model: type[Model],
    tree: Mapping[str, Any],
    *,
    source: str,
    origins: dict[tuple[str, ...], str],
    folder: Path | None = None,
    stored: bool,
) -> Model:
    """Fields that name files find the config's folder in their validation context."""
    try:
        plain = json.dumps(tree)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{source}: holds a value that is no number, text, list or mapping: {error}") from error
    try:
        return model.model_validate_json(plain, context={"folder": folder, **(STORED if stored else {})})
    except ValidationError as error:
        lines = sorted({_describe(model, tree, problem, source=source, origins=origins) for problem in error.errors()})
        raise ConfigError("\n".join(lines)) from error


def _describe(
    model: type[BaseModel], tree: Any, problem: Any, *, source: str, origins: dict[tuple[str, ...], str]
) -> str:
    """One line for one pydantic error. Tags of discriminated unions are no keys and are left out."""
    node, path, line = tree, [], 1
    wanted: set[type[BaseModel]] = {model}
    location = [str(part) for part in problem["loc"]]
    for depth, part in enumerate(location):
        child = _child(node, part)
        last = depth == len(location) - 1
        if child is None and not last:
            continue
        if child is None and last and problem["type"] not in ("missing", "extra_forbidden"):
            if not (isinstance(node, Mapping) and part in node):
                continue
        path.append(part)
        line = _line_of(node, part) or line
        if not last:
            wanted = {inner for outer in wanted for inner in _models_below(outer, part)} or wanted
        node = child
    where = origins.get(tuple(path)) or f"{source}:{line}"
    key = ".".join(path) or "(whole file)"
    match problem["type"]:
        case "extra_forbidden":
            names = sorted({name for known in wanted for name in known.model_fields})
            near = difflib.get_close_matches(path[-1], names, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"known here: {', '.join(names)}"
            return f"{where}: {key}: unknown key; {hint}"
        case "missing":
            return f"{where}: {key}: this key is required"
        case "value_error":
            return f"{where}: {key}: {problem['ctx']['error']}"
        case "literal_error" | "union_tag_invalid":
            given = problem["input"]
            text = problem["msg"]
            return f"{where}: {key}: {text[:1].lower() + text[1:]} (got {_short(given)})"
        case _:
            text = problem["msg"]
            return f"{where}: {key}: {text[:1].lower() + text[1:]} (got {_short(problem['input'])})"


def _short(value: Any) -> str:
    text = repr(dict(value) if isinstance(value, Mapping) else value)
    return text if len(text) <= 60 else text[:57] + "..."


def _line_of(node: Any, part: str) -> int | None:
    if isinstance(node, CommentedMap) and part in node.lc.data:
        return int(node.lc.data[part][0]) + 1
    if isinstance(node, CommentedSeq) and part.isdigit() and int(part) in (node.lc.data or {}):
        return int(node.lc.data[int(part)][0]) + 1
    if isinstance(node, CommentedMap | CommentedSeq):
        return int(node.lc.line) + 1
    return None


def _models_below(model: type[BaseModel], part: str) -> Iterator[type[BaseModel]]:
    """The config models that the field `part` of `model` may hold; list positions stay where they are."""
    if part.isdigit():
        yield model
    elif part in model.model_fields:
        yield from _models_in(model.model_fields[part].annotation)


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in typing.get_args(annotation):
        yield from _models_in(inner)
