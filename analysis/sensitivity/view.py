"""A sensitivity study in the terminal."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..page.numbers import interval
from .findings import VERDICTS

if TYPE_CHECKING:
    from rich.console import Console


def render(summary: Mapping[str, Any], console: "Console") -> None:
    """Prints the findings, the lists of options and the ranking for each source."""
    from rich.padding import Padding  # noqa: PLC0415

    for source in summary["sources"]:
        console.print(f"[bold]{source['name']}[/bold]", highlight=False)
        console.print(source["units"], highlight=False)
        for sentence in source["findings"]:
            console.print(sentence, highlight=False)
        for options in source["lists"]:
            console.print(f"{options['title']}:{'' if options['items'] else ' none.'}", highlight=False)
            for item in options["items"]:
                console.print(Padding(f"- {item}", (0, 0, 0, 2)), highlight=False)
        console.print(_ranking(source))


def _ranking(source: Mapping[str, Any]) -> Any:
    from rich import box  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    name = f"{source['policies'][-1]}_what_error"
    table = Table(title="Choices, the strongest first", title_justify="left", box=box.SIMPLE, padding=(0, 1, 0, 0))
    change = f"its change of the object error ({source['what_unit']})"
    for heading in ("choice", "strongest option", change, "gravest verdict (of which options)"):
        table.add_column(heading, justify="right" if heading == change else "left")
    for choice in source["choices"]:
        option = next(row for row in choice["options"] if row["name"] == choice["strongest"])
        verdict = f"{VERDICTS[choice['verdict']]} ({choice['verdict_of']})"
        table.add_row(choice["name"], option["name"], interval(option, name), verdict)
    return table
