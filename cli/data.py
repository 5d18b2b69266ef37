"""`solidtouch convert` and `solidtouch inspect`: import and check recordings."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from .shared.interrupt import loading
from .shared.options import Force, Missing, WhatCell, WhereCell

if TYPE_CHECKING:
    from ..models.io.recording import Recording
    from ..models.preprocessing import Preprocessing
    from ..models.taps import TapSet

_CUTTING = "Cutting streams"
_LABELS = "Labels"


def convert(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="IN...",
            help="Recordings: .npz, .csv, .mat, .nc, .zarr, .mcap or a folder of .csv files; each of several is one "
            "session.",
            show_default=False,
        ),
    ],
    target: Annotated[Path, typer.Argument(metavar="OUT", help=".nc file to write.", show_default=False)],
    force: Force = False,
    segment: Annotated[
        bool, typer.Option("--segment", help="Cut continuous streams into taps.", rich_help_panel=_CUTTING)
    ] = False,
    trigger: Annotated[
        Literal["clock", "contact"] | None,
        typer.Option(
            help="Start of a tap: every WINDOW frames, or when a taxel reaches LEVEL.", rich_help_panel=_CUTTING
        ),
    ] = None,
    level: Annotated[
        float | None,
        typer.Option(
            help="Preprocessed value that counts as contact; negative if values fall under load.",
            rich_help_panel=_CUTTING,
        ),
    ] = None,
    window: Annotated[int | None, typer.Option(help="Samples per tap.", rich_help_panel=_CUTTING)] = None,
    pre: Annotated[
        int | None, typer.Option(min=0, help="Samples of a tap before contact.", rich_help_panel=_CUTTING)
    ] = None,
    tare: Annotated[
        Literal["none", "stream", "tap"] | None,
        typer.Option(
            help="Subtract the mean of the first samples of the stream or of each tap.", rich_help_panel=_CUTTING
        ),
    ] = None,
    tare_samples: Annotated[
        int | None, typer.Option(help="Number of samples to average for the tare.", rich_help_panel=_CUTTING)
    ] = None,
    highpass: Annotated[
        float | None,
        typer.Option(metavar="HZ", help="Cut-off frequency of a high-pass filter.", rich_help_panel=_CUTTING),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(metavar="HZ", help="Sampling rate, if the file does not state it.", rich_help_panel=_LABELS),
    ] = None,
    sensor: Annotated[str | None, typer.Option(help="Name of the sensor.", rich_help_panel=_LABELS)] = None,
    source: Annotated[str | None, typer.Option(help="Origin of the recording.", rich_help_panel=_LABELS)] = None,
    licence: Annotated[str | None, typer.Option(help="Licence of the recording.", rich_help_panel=_LABELS)] = None,
    units: Annotated[str | None, typer.Option(help="Unit of the samples.", rich_help_panel=_LABELS)] = None,
    where_unit: Annotated[str | None, typer.Option(help="Unit of the positions.", rich_help_panel=_LABELS)] = None,
    what_unit: Annotated[str | None, typer.Option(help="Unit of the object sizes.", rich_help_panel=_LABELS)] = None,
) -> None:
    """Import recorded taps, or cut recorded streams into taps, and write one .nc file."""
    with loading():
        from ..models.errors import InputError
        from ..models.io.joining import joined, relabel
        from ..models.io.load import check_there
        from ..models.storage import check_netcdf_name, check_writable

    check_netcdf_name(target)
    check_writable(target, force)
    cutting = {
        "--trigger": trigger,
        "--level": level,
        "--window": window,
        "--pre": pre,
        "--tare": tare,
        "--tare-samples": tare_samples,
        "--highpass": highpass,
    }
    given = [option for option, value in cutting.items() if value is not None]
    if given and not segment:
        raise InputError(f"{given[0]} requires --segment.")
    if segment:
        _check_cutting(cutting)
    check_there(sources)
    parts = [_taps(path, cutting if segment else None, rate) for path in sources]
    taps = joined(parts, [str(path) for path in sources])
    labelled = relabel(
        taps,
        sensor=sensor,
        source=source,
        licence=licence,
        units=units,
        where_unit=where_unit,
        what_unit=what_unit,
        rate_hz=rate,
    )
    labelled.save(target, force)
    n, j, k = labelled.samples.shape
    taps = f"{n} tap{'s' * (n != 1)} of {j} sample{'s' * (j != 1)}"
    typer.echo(f"{target}: {taps} from {k} taxel{'s' * (k != 1)}.")


def _taps(path: Path, cutting: dict[str, Any] | None, rate_hz: float | None) -> "TapSet":
    """Taps of a file, cut from its streams with `cutting`; prints what was left out."""
    from ..models.io.load import CUT, read_recording
    from ..models.io.recording import naming
    from ..models.taps import TapSet

    if path.suffix.lower() in CUT and cutting is None:
        return TapSet.load(path)
    if path.suffix.lower() == ".mcap" and cutting is None:
        return _recorded(path)
    recording = read_recording(path)
    with naming(path):
        taps = recording.tapset() if cutting is None else _segmented(recording, cutting, rate_hz)
    for name in recording.left_out:
        typer.echo(f"Left out, not one row per tap: {name}.")
    return taps


def _recorded(path: Path) -> "TapSet":
    """Taps of a recording of the rig; prints what was lost."""
    from ..models.io.rig import read_rig, tapset

    recorded = read_rig(path)
    if recorded.lost:
        typer.echo(f"Damaged: {recorded.lost}.")
    return tapset(recorded, path)


def _check_cutting(cutting: dict[str, Any]) -> None:
    """Checks that the options of `--segment` are complete."""
    from ..models.errors import InputError

    if cutting["--window"] is None:
        raise InputError("--segment requires --window, the number of samples per tap.")
    if cutting["--trigger"] is None:
        raise InputError("--segment requires --trigger clock or contact.")
    if cutting["--trigger"] == "contact" and not cutting["--level"]:
        raise InputError("--trigger contact requires a nonzero --level, the value that counts as contact.")
    if cutting["--tare"] in ("stream", "tap") and not cutting["--tare-samples"]:
        raise InputError(f"--tare {cutting['--tare']} requires --tare-samples, the number of samples to average.")


def _preprocessing(cutting: dict[str, Any], rate_hz: float | None) -> "Preprocessing":
    """Preprocessing record from the options."""
    from ..models.preprocessing import Preprocessing

    return Preprocessing(
        samples=cutting["--window"],
        rate_hz=rate_hz,
        tare=cutting["--tare"] or "none",
        tare_samples=cutting["--tare-samples"] or 0,
        highpass_hz=cutting["--highpass"] or 0.0,
        trigger=cutting["--trigger"],
        trigger_level=cutting["--level"] or 0.0,
        pre_samples=cutting["--pre"] or 0,
    )


def _segmented(recording: "Recording", cutting: dict[str, Any], rate_hz: float | None) -> "TapSet":
    """Taps cut from the streams; prints what was lost."""
    from ..models.io.streams import segment

    cut = segment(recording, _preprocessing(cutting, recording.rate_hz if rate_hz is None else rate_hz))
    typer.echo(f"{len(cut.taps)} taps from {cut.streams} streams, {cut.incomplete} incomplete taps left out.")
    for stream in cut.silent:
        typer.echo(f"No tap in the stream of {stream}.")
    return cut.taps


def inspect(
    data: Annotated[
        Path,
        typer.Argument(metavar="DATA", help="Taps: .nc, .zarr, .mcap, .npz, .csv, .mat or a folder of .csv files."),
    ],
    where_cell: WhereCell = None,
    what_cell: WhatCell = None,
    missing: Missing = "refuse",
) -> None:
    """Print sizes, ranges and data-quality warnings of a tap set, and what it can show."""
    with loading():
        from ..analysis.inspect.report import inspect as study
        from .shared.report import show_page

    show_page(study(data, where_cell, what_cell, missing))
