"""`solidtouch convert`: import recordings of any layout."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..models.errors import InputError, counted, shortened
from ..models.io.layouts.mapping import TapMap, check_cutting, load_map, option
from .shared.interrupt import loading
from .shared.map_options import MAP_OPTIONS
from .shared.options import Fields, Force, Missing, given, spelled_out

if TYPE_CHECKING:
    from ..models.taps import TapSet

_OTHER_LAYOUT = "missing column", "missing array", "no column name starts with taxel", "unknown format", "no .csv files"


@spelled_out
def convert(
    context: typer.Context,
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="IN... OUT",
            help="Recordings, files or folders, and the .nc file to write; each of several recordings is one session.",
            show_default=False,
        ),
    ],
    map_file: Annotated[
        Path | None,
        typer.Option("--map", metavar="FILE", help="Map of the recording; options outweigh it.", show_default=False),
    ] = None,
    look: Annotated[
        bool, typer.Option("--look", help="Show what the files hold and a map to begin with; there is no OUT.")
    ] = False,
    force: Force = False,
    missing: Missing = "refuse",
    segment: Annotated[
        bool, typer.Option("--segment", help="Cut continuous streams into taps.", rich_help_panel="Cutting streams")
    ] = False,
    options: Annotated[TapMap, Fields(**MAP_OPTIONS)] = TapMap(),
) -> None:
    """Import recorded taps, or cut recorded streams into taps, and write one .nc file."""
    with loading():
        from ..models.io.joining import joined
        from ..models.io.load import check_there
        from ..models.storage import check_netcdf_name, check_writable

    how = options
    if map_file is not None:
        chosen = {name: getattr(options, name) for name in MAP_OPTIONS if given(context, name)}
        how = load_map(map_file).changed(**chosen)
    if look:
        from ..models.io.layouts.first_look.look import look as looked

        typer.echo(looked(sources, how), nl=False)
        return
    *sources, target = sources
    if not sources:
        raise InputError(f"{target}: name the recordings and the .nc file to write, or --look to see what is there.")
    check_netcdf_name(target)
    check_writable(target, force)
    if segment and how.trigger is None:
        raise InputError(f"--segment requires {option('trigger')}, such as contact.")
    check_cutting(how)
    check_there(sources)
    if map_file is not None or how.says_something:
        taps = _mapped(sources, how, missing, None if map_file is None else map_file.parent)
    else:
        with _looking_helps():
            parts = [_taps(path, how, missing) for path in sources]
        taps = _labelled(joined(parts, [str(path) for path in sources]), how)
    taps.save(target, force)
    _tell(target, taps, how)


def _mapped(sources: list[Path], how: TapMap, missing: Missing, folder: Path | None) -> "TapSet":
    """Taps of files of any layout; prints what was cut and left out."""
    from ..models.io.layouts.tap_set import load_mapped

    taps, told = load_mapped(sources, how, missing, folder)
    for sentence in told:
        typer.echo(sentence)
    return taps


def _labelled(taps: "TapSet", how: TapMap) -> "TapSet":
    """Taps of this software's layout with the units, the rate and the origin that options state."""
    from ..models.io.joining import relabel

    return relabel(
        taps,
        sensor=how.sensor,
        source=how.source,
        licence=how.licence,
        units=how.units,
        where_unit=how.where_unit,
        what_unit=how.what_unit,
        rate_hz=how.rate,
        citation=how.citation,
    )


def _tell(target: Path, taps: "TapSet", how: TapMap) -> None:
    """Prints what was written, and what the map says of its origin."""
    n, j, k = taps.samples.shape
    typer.echo(f"{target}: {counted(n, 'tap')} of {counted(j, 'sample')} from {counted(k, 'taxel')}.")
    where, rate = sorted(set(taps.where.tolist())), taps.preprocessing.rate_hz
    line = len(where) > 1 and "where_place" not in taps.dataset.coords
    objects = [taps.what_name[m] for m in sorted(set(taps.what.tolist()))]
    typer.echo(
        f"{counted(len(objects), 'object')}{f' ({shortened(objects)})' if len(objects) > 1 else ''}, "
        f"{counted(len(where), 'position')}"
        f"{f' from {where[0]:g} to {where[-1]:g} {taps.where_unit}'.rstrip() if line else ''}, "
        f"{counted(len(set(taps.session.tolist())), 'session')}, {'no rate' if rate is None else f'{rate:g} Hz'}."
    )
    for name, text in (("Licence", how.licence), ("Cite as", how.citation)):
        if text:
            typer.echo(f"{name}: {text}.".replace("..", "."))


@contextmanager
def _looking_helps() -> Iterator[None]:
    """Adds to errors of a recording of another layout how to go on."""
    try:
        yield
    except InputError as error:
        if "--look" in str(error) or not any(words in str(error) for words in _OTHER_LAYOUT):
            raise
        raise InputError(f"{error} For any other layout see convert --look.") from error


def _taps(path: Path, how: TapMap, missing: Missing) -> "TapSet":
    """Taps of a file of this software's layout; prints what was left out."""
    from ..models.io.layouts.tap_set import cut_already, cut_streams, without_useless
    from ..models.io.load import CUT, read_recording
    from ..models.io.recording import naming
    from ..models.taps import TapSet

    is_set = path.suffix.lower() in CUT
    if how.trigger is None and (is_set or path.suffix.lower() == ".mcap"):
        if how.resample is not None:
            raise InputError(f"{path}: {option('resample')} is for frames, and for taps that are not in a tap set yet.")
        loaded = TapSet.load(path, missing) if is_set else _recorded(path)
        with naming(path):
            taps, told = without_useless(loaded, how)
        left_out: tuple[str, ...] = ()
    else:
        recording = read_recording(path, missing)
        with naming(path):
            taps, told = cut_already(recording, how, missing) if how.trigger is None else cut_streams(recording, how)
        left_out = recording.left_out
    for sentence in (*told, *left_out):
        typer.echo(sentence)
    return taps


def _recorded(path: Path) -> "TapSet":
    """Taps of a recording of the rig; prints what was lost."""
    from ..models.io.rig import read_rig, tapset

    recorded = read_rig(path)
    if recorded.lost:
        typer.echo(f"Damaged: {recorded.lost}.")
    return tapset(recorded, path)
