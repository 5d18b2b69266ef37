"""Pages of the commands for the site."""

import re

from benchmarks.site import exit_codes
from benchmarks.site.commands import Command, Parameter, commands

FOLDER = "reference/commands"
_CODE_OR_MARKUP = re.compile(r"(?P<code>`[^`]*`)|[\\*_<>\[\]{}$~^#|]")


def command_pages() -> dict[str, str]:
    """A page for each command by its staged path, and the page that lists them."""
    every = commands()
    ones = exit_codes.of_ones()
    return {path(command): _page(command, ones) for command in every[1:]} | {f"{FOLDER}/index.md": _index(every)}


def path(command: Command) -> str:
    """Staged path of the page of a command."""
    return f"{FOLDER}/{'-'.join(command.words)}.md"


def escaped(text: str) -> str:
    """Text of `--help` as Markdown; what stands in backticks stays code."""
    return _CODE_OR_MARKUP.sub(lambda found: found["code"] or f"\\{found[0]}", text)


def explained(parameter: Parameter) -> str:
    """What a parameter does, with its default and whether it is required or repeatable."""
    notes = [
        "Required." if parameter.required and parameter.names else "",
        "Repeatable." if parameter.repeatable and parameter.names and "repeatable" not in parameter.text else "",
        f"Default: `{parameter.default}`." if parameter.default else "",
    ]
    return " ".join(filter(None, [parameter.text, *notes]))


def _index(every: list[Command]) -> str:
    program, *others = every
    rows = [f"| [`{command.name}`]({'-'.join(command.words)}.md) | {escaped(command.summary)} |" for command in others]
    names = ["-".join(command.words) for command in others]
    return "\n".join(
        [
            "# Command line",
            "",
            f"{escaped(program.text)}",
            "`solidtouch --help` lists the commands, `solidtouch COMMAND --help` the options of one.",
            "All of them share the same [exit codes](../exit-codes.md).",
            "`solidtouch --install-completion` makes the Tab key complete commands, options and their values.",
            "",
            "| command | what it does |",
            "|---|---|",
            *rows,
            "",
            *_options(program),
            "```{toctree}",
            ":hidden:",
            "",
            *names,
            "```",
            "",
        ]
    )


def _page(command: Command, ones: dict[str, str]) -> str:
    lines = [f"# {command.name}", "", escaped(command.text), "", "```text", command.usage, "```", ""]
    for part in command.parts:
        words = (*command.words, part)
        lines += [f"- [`solidtouch {' '.join(words)}`]({'-'.join(words)}.md)"]
    lines += [""]
    if command.arguments:
        lines += ["## Arguments", ""]
        for argument in command.arguments:
            lines += [f"`{argument.value}`", f": {escaped(explained(argument)) or 'Required.'}", ""]
    lines += _options(command)
    lines += ["## Exit codes", "", _codes(command, ones), ""]
    return "\n".join(lines)


def _options(command: Command) -> list[str]:
    lines = []
    if command.options:
        lines += [f"```{{program}} {command.name}", "```", ""]
    for panel in dict.fromkeys(option.panel for option in command.options):
        lines += [f"## {f'Options: {panel.lower()}' if panel else 'Options'}", ""]
        for option in (option for option in command.options if option.panel == panel):
            names = ", ".join(f"{name} {option.value}".strip() for name in option.names)
            lines += [f"```{{option}} {names}", escaped(explained(option)), "```", ""]
    return lines


def _codes(command: Command, ones: dict[str, str]) -> str:
    own = ones.get(" ".join(command.words))
    usual = "0, 2, 130 and 143 as for [all commands](../exit-codes.md)"
    return f"1: {own} {usual}." if own else f"{usual}."
