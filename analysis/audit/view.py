"""An audit in the terminal."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..page.numbers import factor, interval, number

if TYPE_CHECKING:
    from rich.console import Console


def render(summary: Mapping[str, Any], console: "Console") -> None:
    """Prints the verdict, what makes evidence vary, and what remedies buy."""
    from rich import box  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    for sentence in summary["verdict"]["sentences"]:
        console.print(sentence, highlight=False)
    variance = summary["first_cause"]["evidence"]["variance"]
    if variance is not None and variance["classes"]:
        table = Table(
            title=f"Variance of the evidence of {variance['taps']} taps",
            title_justify="left",
            box=box.SIMPLE,
            padding=(0, 1, 0, 0),
        )
        table.add_column("part")
        table.add_column("share [95 % interval]", justify="right")
        for part in variance["parts"]:
            table.add_row(part["words"], interval(part, "share"))
        console.print(table)
    console.print(_remedies(summary["remedy"], summary["units"]["what"]))
    for row in summary["remedy"]["evidence"]["refused"]:
        console.print(f"Not possible here: {row['name']}. {row['reason']}", highlight=False)
    target = summary["remedy"]["evidence"]["target_error"]
    if target is not None:
        console.print(target["sentence"], highlight=False)
    for sentence in summary["warnings"]:
        console.print(f"Warning: {sentence}", highlight=False)


def _remedies(remedy: Mapping[str, Any], unit: str) -> Any:
    from rich import box  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    evidence = remedy["evidence"]
    table = Table(
        title=f"Remedies by gain in log score per tap; errors at {evidence['reaction_time']:.1f} taps",
        title_justify="left",
        box=box.SIMPLE,
        padding=(0, 1, 0, 0),
    )
    for heading in ("remedy", "gain per tap (nat)", f"change of error ({unit})", "factor", "helps"):
        table.add_column(heading, justify="left" if heading in ("remedy", "helps") else "right")
    for row in [evidence["as_it_is"], *evidence["ranking"]]:
        table.add_row(
            row["name"] + (" (chosen)" if row["name"] == remedy["chosen"] else ""),
            _triple(row["gain_per_tap"]),
            _triple(row["error_change"]),
            factor(row["factor"], row["unbounded"]),
            {True: "yes", False: "no"}.get(row.get("worthwhile"), ""),
        )
    return table


def _triple(values: Any) -> str:
    if not values or values[0] is None:
        return number(None)
    return interval(dict(zip(("v", "v_low", "v_high"), values, strict=True)), "v")
