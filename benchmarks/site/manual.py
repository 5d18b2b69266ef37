"""Man pages of all commands, from the same source as the command line reference of the site.

`python -m benchmarks.site.manual [FOLDER]` (`make man`) writes solidtouch.1, solidtouch-fit.1, ... into build/man.
"""

import re
from argparse import ArgumentParser
from importlib.metadata import version
from pathlib import Path

from solidtouch.models.storage import complete_file

from benchmarks.site import exit_codes
from benchmarks.site.command_pages import explained
from benchmarks.site.commands import Command, Parameter, commands

OUT = Path("build/man")


def manual() -> dict[str, str]:
    """Text of each man page by its file name."""
    every = commands()
    return {f"{command.name.replace(' ', '-')}.1": _page(command, every) for command in every}


def roff(text: str) -> str:
    """Text as roff: signs escaped, code in bold."""
    text = text.replace("\\", "\\e").replace("-", "\\-").replace("'", "\\(aq").replace("`", "\0")
    text = re.sub("\0([^\0]*)\0", r"\\fB\1\\fR", text)
    return "\n".join(f"\\&{line}" if line.startswith(".") else line for line in text.split("\n"))


def _page(command: Command, every: list[Command]) -> str:
    name = command.name.replace(" ", "-")
    lines = [
        f'.TH {name.upper()} 1 "" "solidtouch {version("solidtouch")}" "User Commands"',
        ".SH NAME",
        f"{roff(name)} \\- {roff(_phrase(command.summary))}",
        ".SH SYNOPSIS",
        f".B {roff(command.usage)}",
        ".SH DESCRIPTION",
        "\n.PP\n".join(roff(" ".join(part.split("\n"))) for part in command.text.split("\n\n")),
    ]
    parts = [other for other in every if other.words[:-1] == command.words and other.words]
    if parts:
        lines += [".SH COMMANDS", *(_item(f"`{other.words[-1]}`", other.summary) for other in parts)]
    if command.arguments:
        lines += [".SH ARGUMENTS", *(_item(f"`{part.value}`", explained(part)) for part in command.arguments)]
    for panel in dict.fromkeys(option.panel for option in command.options):
        lines += [f'.SH "OPTIONS{f": {roff(panel).upper()}" if panel else ""}"']
        lines += [_item(_label(option), explained(option)) for option in command.options if option.panel == panel]
    lines += [".SH EXIT STATUS", *_statuses(command)]
    lines += [".SH SEE ALSO", _others(command, every)]
    return "\n".join(lines) + "\n"


def _phrase(sentence: str) -> str:
    """A summary as the line of names has it: without a full stop."""
    return sentence.rstrip(".").replace("\n", " ")


def _label(option: Parameter) -> str:
    return ", ".join(f"`{name}`{f' {option.value}' if option.value else ''}" for name in option.names)


def _item(label: str, text: str) -> str:
    return f".TP\n{roff(label)}\n{roff(text) or 'Required.'}"


def _statuses(command: Command) -> list[str]:
    own = exit_codes.of_ones().get(" ".join(command.words))
    codes = exit_codes.of_all()
    if command.words:
        codes = {code: meaning for code, meaning in codes.items() if code != "1"} | ({"1": own} if own else {})
    return [_item(f"`{code}`", codes[code]) for code in sorted(codes, key=int)]


def _others(command: Command, every: list[Command]) -> str:
    shown = every[1:] if not command.words else [every[0], *(o for o in every[1:] if o.words[0] == command.words[0])]
    names = [other.name.replace(" ", "-") for other in shown if other is not command]
    return ",\n".join(f".BR {roff(name)} (1)" for name in names)


def write(folder: Path) -> int:
    """Writes all man pages into a folder and returns their number."""
    folder.mkdir(parents=True, exist_ok=True)
    pages = manual()
    for old in set(folder.glob("solidtouch*.1")) - {folder / name for name in pages}:
        old.unlink()
    for name, text in pages.items():
        with complete_file(folder / name, force=True) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return len(pages)


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=OUT)
    folder = parser.parse_args().folder
    print(f"{write(folder)} man pages are in {folder}; read one with: man -l {folder / 'solidtouch.1'}")
