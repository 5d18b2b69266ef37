"""`solidtouch simulate`: data sets from the simulated rig or from a fitted model."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from ..models.errors import InputError
from .shared.completion import presets_or_model
from .shared.interrupt import loading
from .shared.options import Seed, Story

if TYPE_CHECKING:
    from ..models.taps import TapSet

_MODEL = "model"


def simulate(
    out: Annotated[Path, Option(help="Folder for session-0.nc, session-1.nc, ...; created if needed.")],
    preset: Annotated[
        str,
        Option(
            help="Preset of the rig: paper, ideal, broken, hold2, nodrift, or model (requires --model).",
            autocompletion=presets_or_model,
        ),
    ] = "paper",
    sessions: Annotated[int, Option(help="Number of sessions.")] = 2,
    seed: Seed = 0,
    data_set: Annotated[
        int, Option(min=0, help="Number of the data set, as in reproduce; its sessions share the sensor.")
    ] = 0,
    force: Annotated[bool, Option("--force", help="Overwrite existing files.")] = False,
    model: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="With --preset model: fitted model to draw taps from, or FILE.py:FUNCTION, from whose prior come taps "
            "like those of preset paper.",
        ),
    ] = None,
    story: Story = None,
    samples: Annotated[
        int | None, Option(help="With --preset model: samples per tap; default: as in the model.")
    ] = None,
    taps_per_class: Annotated[int | None, Option(help="With --preset model: taps per class; default: 20.")] = None,
) -> None:
    """Simulate sessions of taps, one file each."""
    with loading():
        from rich.progress import track

        from ..models.seeds import data_set_seed
        from ..models.storage import check_writable

    if sessions < 1:
        raise InputError(f"--sessions must be at least 1, got {sessions}.")
    drawn = preset == _MODEL
    if not drawn and any(option is not None for option in (model, samples, taps_per_class)):
        raise InputError("--model, --samples and --taps-per-class require --preset model.")
    own = data_set_seed(seed, data_set)
    make = _from_model(model, story, samples, taps_per_class, own) if drawn else _from_rig(preset, own)
    paths = [_folder(out) / f"session-{session}.nc" for session in range(sessions)]
    for path in paths:
        check_writable(path, force)
    for session, path in enumerate(track(paths, description=f"Simulating {preset}", transient=True)):
        make(session).save(path, force)
    number = f", data set {data_set} (its own seed is {own})" if data_set else ""
    print(f"{sessions} session{'s' * (sessions > 1)} of preset {preset}, seed {seed}{number}, in {out}")


def _from_rig(name: str, seed: int) -> Callable[[int], "TapSet"]:
    with loading():
        from ..hardware.simulator.session import simulate_session
        from ..hardware.simulator.settings import preset

    settings = preset(name, (_MODEL,))
    return lambda session: simulate_session(settings, seed, session)


def _from_model(
    path: Path | None, story: str | None, samples: int | None, taps_per_class: int | None, seed: int
) -> Callable[[int], "TapSet"]:
    with loading():
        from ..hardware.simulator.model_rig import draw_from_prior, draw_session
        from ..hardware.simulator.session import simulate_session
        from ..hardware.simulator.settings import preset
        from ..models.io.model_file import load_model
        from ..models.measurement.generic import source

    if path is None:
        raise InputError("--preset model requires --model, the file of a fitted model.")
    n = 20 if taps_per_class is None else taps_per_class
    if source.has_name(str(path)):
        like = simulate_session(preset("paper"), seed, 0)
        if samples is not None:
            raise InputError("--samples is for fitted models; taps from a prior are like those of preset paper.")
        return lambda session: draw_from_prior(str(path), like, n, seed, session)
    model = load_model(path, story)
    return lambda session: draw_session(model, n, seed, session, samples)


def _folder(path: Path) -> Path:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot create the folder: {error.strerror}.") from error
    return path
