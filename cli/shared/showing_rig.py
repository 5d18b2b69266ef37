"""Display of a rig check on a terminal."""

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...hardware.rig.check import RigReport


def show_report(report: RigReport, console: Console) -> None:
    """Prints the findings, then the problems."""
    found = Table.grid(padding=(0, 2))
    for word, value in report.lines:
        found.add_row(Text(word), Text(value))
    console.print(found)
    if (sensor := report.sensor) is not None:
        console.print(
            f"  {sensor.readings} readings, {sensor.rate_hz:.2f} per second, {100 * sensor.loss:.2g}% lost; in "
            "units of the sensor, noise as standard deviation:",
            highlight=False,
        )
        taxels = Table(box=None, padding=(0, 2))
        for column in ("  taxel", "at rest", "noise", "drift per minute", "± 95%"):
            taxels.add_column(column, justify="right")
        columns = zip(sensor.idle, sensor.noise, sensor.drift_per_min, sensor.drift_error, strict=True)
        for k, (idle, noise, drift, error) in enumerate(columns):
            taxels.add_row(str(k), f"{idle:.1f}", f"{noise:.2f}", f"{drift:+.1f}", f"{error:.1f}")
        console.print(taxels)
    for sentence in report.wrong:
        console.print(Text(f"! {sentence}", style="bold"))
    if not report.wrong:
        console.print("No problems found.")
