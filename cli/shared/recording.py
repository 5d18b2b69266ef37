"""`--record`: recording of a rig during a live command."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ...models.errors import InputError

if TYPE_CHECKING:
    from ...hardware.recording.recording import Recorder
    from ...models.grid import ClassGrid
    from ...models.io.rig_recording import About


def check_record(path: Path, rig: str, force: bool) -> None:
    """Checks that a recording can be written and that the rig has devices.

    Raises:
        InputError: The rig is not a rig.toml, the name does not end in `.mcap`, or the file cannot be written.
    """
    from ...models.storage import check_writable

    if not rig.endswith(".toml"):
        raise InputError(f"--record requires a rig.toml as --rig, got {rig!r}.")
    if path.suffix.lower() != ".mcap":
        raise InputError(f"--record must name an .mcap file, got {path}.")
    check_writable(path, force)


@contextmanager
def recording(
    path: Path | None, rig: str, grid: "ClassGrid", what: str | None, taps: int, force: bool
) -> Iterator["Recorder | None"]:
    """Recorder of a rig, closed at the end of the block; a file without a tap is removed if the block fails.

    Args:
        path: The file, `None` for no recording.
        rig: The rig.toml.
        grid: The classes of the model.
        what: Object of `--object`.
        taps: Maximum number of taps.
        force: Whether an existing file may be replaced.

    Raises:
        InputError: The file cannot be written, or its disk lacks space for so many taps.
    """
    if path is None:
        yield None
        return
    from ...hardware.recording.recording import Recorder, check_space, space_needed
    from ...hardware.rig.settings import load_rig

    settings = load_rig(rig)
    check_space(path, space_needed(taps, settings))
    recorder = Recorder.create(path, _about(rig, grid, what), force=force)
    try:
        with recorder:
            yield recorder
    except BaseException:
        if recorder.presses:
            print(kept(recorder), file=sys.stderr)
        else:
            path.unlink(missing_ok=True)
        raise


def kept(recorder: "Recorder") -> str:
    """Content and next use of a recording, as a sentence."""
    path, presses = recorder.path, recorder.presses
    if recorder.taps:
        return f"{path}: {recorder.taps} taps; convert them with `solidtouch convert {path} TAPS.nc`."
    return f"{path}: {presses} presses of an unknown object, not convertible to a tap set; name it with --object."


def _about(rig: str, grid: "ClassGrid", what: str | None) -> "About":
    from msgspec.structs import replace

    from ...hardware.named_rigs import objects
    from ...hardware.recording.settings import about_rig
    from ...hardware.rig.settings import load_rig
    from ...models.io.toml import read_settings

    names = objects(grid, what)
    sized = grid.what_value is not None and grid.what_unit == "mm" and len(names) == grid.M
    sizes = grid.what_value.tolist() if sized and grid.what_value is not None else []
    return replace(about_rig(load_rig(rig), read_settings(rig)), objects=names, sizes_mm=sizes)
