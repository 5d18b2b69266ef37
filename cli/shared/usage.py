"""Errors in the use of a command as one plain sentence, instead of Typer's box and the words of pydantic."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import typer
from typer.core import TyperGroup

from ...models.errors import InputError

_PROBLEM: Any = typer.BadParameter.__mro__[2]  # ClickException, which Typer does not export
_BOUNDS = {
    "greater_than_equal": ("at least", "ge"),
    "greater_than": ("above", "gt"),
    "less_than_equal": ("at most", "le"),
    "less_than": ("below", "lt"),
}
_KINDS = {"int": "a whole number", "float": "a number", "bool": "true or false"}


class PlainGroup(TyperGroup):
    """Commands whose wrong use is an `InputError`."""

    def make_context(self, *args: Any, **options: Any) -> Any:
        """As Typer."""
        with _plain():
            return super().make_context(*args, **options)

    def invoke(self, ctx: Any) -> Any:
        """As Typer."""
        with _plain():
            return super().invoke(ctx)


@contextmanager
def _plain() -> Iterator[None]:
    try:
        yield
    except _PROBLEM as error:
        context = getattr(error, "ctx", None)
        if context is None or type(error).__name__ == "NoArgsIsHelpError":
            raise
        raise InputError(f"{_sentence(error)}; see `{context.command_path} --help`.") from error


def _sentence(error: Any) -> str:
    details = _details(error)
    parameter = getattr(error, "param", None)
    if details is not None and parameter is not None:
        name = parameter.get_error_hint().replace("'", "")
        return f"{name} {_wanted(details)}"
    text = " ".join(error.format_message().split()).rstrip(".")
    return text[:1].lower() + text[1:]


def _details(error: Any) -> dict[str, Any] | None:
    """What pydantic says about a value that it refused, if it did."""
    listed: Any = getattr(error.__cause__, "errors", None)
    return None if listed is None else listed()[0]


def _wanted(details: dict[str, Any]) -> str:
    kind, got = details["type"], details.get("input")
    context: Any = details.get("ctx", {})
    if kind in _BOUNDS:
        words, key = _BOUNDS[kind]
        return f"must be {words} {context[key]:g}, got {got}"
    if (wanted := _KINDS.get(kind.partition("_")[0])) is not None:
        return f"must be {wanted}, got {got!r}"
    return f"is wrong: {details['msg'].removeprefix('Value error, ').rstrip('.')}"
