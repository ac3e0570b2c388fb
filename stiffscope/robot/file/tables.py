"""Conversion of robot file tables to sections, with pydantic's errors in terms of the file."""

from __future__ import annotations

import typing
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from pydantic import BaseModel, ValidationError

from stiffscope.errors import FieldError, InputError, suggest
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file.parse import split_place
from stiffscope.robot.file.values import Reads, Says

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from stiffscope.errors import Key

Model = TypeVar("Model", bound=BaseModel)
_EXPECTED = {
    "dict_type": "a table",
    "tuple_type": "a list",
    "list_type": "a list",
    "string_type": "a text in quotes",
}


def read_table(model: type[Model], value: Any, key: Key) -> Model:
    """Read a table as a section; raise FieldError for its first error.

    Parameters
    ----------
    model
        Model of the section.
    value
        Value in the file.
    key
        Key of the value: keys of its tables, outermost first.
    """
    try:
        return model.model_validate(value)
    except ValidationError as error:
        inner, message = _first(error, model)
        raise FieldError((*key, *inner), message) from error


def one_of(word: Any, valid: Iterable[str], what: str) -> str:
    """Return a word if it is valid; otherwise raise ValueError, with the closest match.

    Parameters
    ----------
    word
        Word to check.
    valid
        Valid words.
    what
        Description of the expected value, for messages.
    """
    valid = list(valid)
    if isinstance(word, str) and word in valid:
        return word
    wanted = f"{what} ({list_some(valid, 20) or 'none'})"
    raise ValueError(f"{q.expected(wanted, word)}{suggest(str(word), valid)}")


def list_some(words: Sequence[str], most: int = 12) -> str:
    """List words with commas, the first ones of many."""
    return ", ".join([*words[:most], *(["…"] if len(words) > most else [])])


def unknown_key(word: str, valid: Sequence[str]) -> str:
    """Message for a key that a table cannot have."""
    return (
        f'expected a known key ({", ".join(valid)}), got "{word}"{suggest(word, valid)}'
    )


def keys_of(model: type[BaseModel]) -> list[str]:
    """Return the keys of a section, as spelled in the file."""
    return [field.alias or name for name, field in model.model_fields.items()]


def _first(error: ValidationError, model: type[BaseModel]) -> tuple[Key, str]:
    """Return key and message of the first error; unknown keys take precedence over missing ones."""
    errors = error.errors(include_url=False)
    item = next(
        (each for each in errors if each["type"] == "extra_forbidden"), errors[0]
    )
    kind = item["type"]
    place = tuple(item["loc"])
    context = item.get("ctx", {})
    key: Key = tuple(
        part for part in place if not str(part).startswith(("function-", "tagged-"))
    )
    if kind == "extra_forbidden":
        return key, unknown_key(str(key[-1]), keys_of(_model_at(model, place[:-1])))
    if kind == "missing":
        description = _describe_missing(_model_at(model, place[:-1]), str(key[-1]))
        return key, f"expected {description}, got nothing"
    expected = (
        context.get("expected") if kind == "literal_error" else _EXPECTED.get(kind)
    )
    if kind == "model_type":
        expected = f"a table of {', '.join(keys_of(_model_at(model, key)))}"
    if expected:
        return key, q.expected(expected, item["input"])
    message = item["msg"].removeprefix("Value error, ")
    if not isinstance(context.get("error"), InputError):
        return key, message
    inner, description = split_place(message)  # "frame.x: expected …"
    return (*key, *inner[1:]), description


def _describe_missing(model: type[BaseModel], key: str) -> str:
    """Return the description of a missing key's value."""
    fields = model.model_fields.items()
    field = next((field for name, field in fields if key in {name, field.alias}), None)
    notes = [
        note
        for note in (field.metadata if field else ())
        if isinstance(note, Reads | Says)
    ]
    notes_said = [note.says if isinstance(note, Reads) else note for note in notes]
    words = (
        typing.get_args(field.annotation)
        if field and typing.get_origin(field.annotation) is Literal
        else ()
    )
    return (
        notes_said[-1]
        if notes_said
        else f"one of {list_some(words)}"
        if words
        else "a value"
    )


def _model_at(model: type[BaseModel], key: Key) -> type[BaseModel]:
    """Return the section's model at a pydantic location; "tagged-MODEL" selects one of several."""
    several: list[type[BaseModel]] = []
    for part in key:
        tagged = next(
            (section for section in several if part == f"tagged-{section.__name__}"),
            None,
        )
        field = None if isinstance(part, int) else model.model_fields.get(part)
        if tagged is not None:
            model = tagged
        if field is not None:
            several = list(_models(field.annotation))
            model = next(iter(several), model)
    return model


def _models(annotation: Any) -> Iterable[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    else:
        for inner in typing.get_args(annotation):
            yield from _models(inner)
