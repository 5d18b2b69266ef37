"""The commands of `solidtouch` with their arguments and options, read from the commands themselves."""

from collections.abc import Iterator
from dataclasses import dataclass
from inspect import cleandoc
from typing import Any, Literal, get_args, get_origin

import typer.main
from solidtouch.cli.main import app


@dataclass(frozen=True)
class Parameter:
    """An argument or option.

    Attributes:
        names: Names of an option, such as `--seed`; none of an argument.
        value: What is given to it, such as `FILE`; empty for a switch.
        choices: Its values, where they are listed.
        default: Its default as on the command line; empty if there is none to show.
        required: Whether it must be given.
        repeatable: Whether it may be given several times.
        panel: Heading under which `--help` shows it; empty for the usual one.
        text: What it does.
    """

    names: tuple[str, ...]
    value: str
    choices: tuple[str, ...]
    default: str
    required: bool
    repeatable: bool
    panel: str
    text: str

    @property
    def label(self) -> str:
        """Names and value."""
        return " ".join(part for part in ("/".join(self.names), self.value) if part)


@dataclass(frozen=True)
class Command:
    """A command or a group of commands.

    Attributes:
        words: Its name after `solidtouch`, such as `("rig", "check")`.
        text: What it does; the first sentence is a summary.
        arguments: Arguments in their order.
        options: Options in the order of `--help`.
        parts: Names of the commands of a group.
    """

    words: tuple[str, ...]
    text: str
    arguments: tuple[Parameter, ...]
    options: tuple[Parameter, ...]
    parts: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """All words, beginning with `solidtouch`."""
        return " ".join(("solidtouch", *self.words))

    @property
    def usage(self) -> str:
        """How it is called."""
        given = [option.label for option in self.options if option.required]
        more = [] if len(given) == len(self.options) else ["[OPTIONS]"]
        called = [part.value if part.required else f"[{part.value}]" for part in self.arguments]
        called += ["COMMAND"] * bool(self.parts)
        return " ".join((self.name, *given, *more, *called))

    @property
    def summary(self) -> str:
        """The first paragraph."""
        return self.text.partition("\n\n")[0]


def commands() -> list[Command]:
    """The program and all its commands, groups before what is in them."""
    return list(_walk(typer.main.get_command(app), ()))


def _walk(command: Any, words: tuple[str, ...]) -> Iterator[Command]:
    parts = getattr(command, "commands", {})
    made = [(param.param_type_name, _parameter(param)) for param in command.params if not param.hidden]
    arguments = tuple(parameter for kind, parameter in made if kind == "argument")
    options = tuple(parameter for kind, parameter in made if kind == "option")
    text = (command.callback and command.callback.__doc__) or command.help
    yield Command(words, cleandoc(text), arguments, options, tuple(parts))
    for name, part in parts.items():
        yield from _walk(part, (*words, name))


def _parameter(param: Any) -> Parameter:
    option = param.param_type_name == "option"
    choices = _choices(param.type_descriptor.annotation)
    switch = option and param.is_flag
    bare: str = param.bare_type()
    kind = param.metavar or "|".join(choices) or _KINDS.get(bare, bare.upper())
    return Parameter(
        names=tuple(param.opts + param.secondary_opts) if option else (),
        value="" if switch else kind if option else param.metavar or param.name.upper(),
        choices=choices,
        default=_default(param),
        required=param.required,
        repeatable=param.multiple or param.nargs == -1,
        panel=getattr(param, "rich_help_panel", None) or "",
        text=param.help or "",
    )


_KINDS = {"str": "TEXT", "int": "N", "float": "X", "Path": "PATH"}


def _choices(annotation: Any) -> tuple[str, ...]:
    """Values of a literal, also of one that may be missing or repeated."""
    if get_origin(annotation) is Literal:
        return tuple(map(str, get_args(annotation)))
    return next(filter(None, map(_choices, get_args(annotation))), ())


def _default(param: Any) -> str:
    value = param.default
    if callable(value) or value is None or value is False or value == () or not getattr(param, "show_default", True):
        return ""
    if value is True:
        return param.opts[0] if param.secondary_opts else ""
    return ",".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
