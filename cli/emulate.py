"""`solidtouch emulate`: an emulated bench on pseudo-terminals, for any program that opens serial ports."""

import json
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ..models.errors import InputError
from .shared.interrupt import loading, terminable

if TYPE_CHECKING:
    from ..hardware.emulator.faults import Switches


def _list_faults(faults: list[str] | None) -> list[str] | None:
    if "list" not in (faults or ()):
        return faults
    from rich.console import Console
    from rich.table import Table

    from ..hardware.emulator.faults import FAULTS

    table = Table("fault", "row", "where", "what happens", box=None)
    for name, known in FAULTS.items():
        table.add_row(name, str(known.number), known.where, known.meaning)
    Console().print(table)
    raise typer.Exit


def emulate(
    out: Annotated[Path, typer.Option(help="Folder for the ports, the control socket and rig.toml; made if needed.")],
    preset: Annotated[str, typer.Option(help="Which simulated finger and objects, as in simulate.")] = "paper",
    seed: Annotated[int, typer.Option(min=0, help="Which sensor, and all noise.")] = 0,
    session: Annotated[int, typer.Option(min=0, help="Which mounting of the objects.")] = 0,
    sensor: Annotated[
        Literal["icub", "lines"], typer.Option(help="Behind a CAN adapter, or one line of text per reading.")
    ] = "icub",
    homed: Annotated[bool, typer.Option("--homed", help="The stage knows already where it is.")] = False,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="Time goes on as outside, for programs that know no shared clock.")
    ] = False,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            help="NAME[:key=value,...], a fault that is on from the start; `--fault list` lists them.",
            callback=_list_faults,
            is_eager=True,
        ),
    ] = None,
) -> None:
    """Emulates stage and fingertip until Ctrl-C."""
    with loading():
        from ..hardware.emulator.emulated_bench import emulated_bench
        from ..hardware.emulator.faults import Switches
        from ..hardware.emulator.rig_file import write_rig
        from ..hardware.emulator.service import Service, check_free
        from ..hardware.simulator.presets import preset as settings_of

    settings = settings_of(preset)
    control = (out / "control").absolute()
    check_free(control)  # before its ports are replaced
    switches = Switches(seed)
    for words in fault or ():
        switch_on(switches, words)
    with (
        terminable(),
        emulated_bench(
            out,
            settings,
            seed=seed,
            session=session,
            kind=sensor,
            name=f"emulated {preset}",
            shared_clock=not real_time,
            homed=homed,
            switches=switches,
        ) as (rig, emulation, _),
    ):
        emulation.control({})  # a port that is busy is so from the start
        with Service(emulation, control, real_time) as service:
            path = out / "rig.toml"
            write_rig(path, rig, list(emulation.objects))
            print(f"Emulating {rig.name} in {out}; Ctrl-C ends it.", flush=True)
            print(f"Try it from another terminal: solidtouch rig check {path}", flush=True)
            with suppress(KeyboardInterrupt):
                service.run()


def switch_on(switches: "Switches", words: str) -> None:
    """Switches on a fault given as `NAME[:key=value,...]`; values are JSON, or text.

    Raises:
        InputError: There is no such fault or parameter.
    """
    name, _, rest = words.partition(":")
    parameters: dict[str, Any] = {}
    for pair in filter(None, rest.split(",")):
        key, equals, value = pair.partition("=")
        if not equals:
            raise InputError(f"--fault {words}: {pair!r} is no key=value.")
        try:
            parameters[key.strip()] = json.loads(value)
        except json.JSONDecodeError:
            parameters[key.strip()] = value
    try:
        switches.on(name, **parameters)
    except TypeError as error:
        raise InputError(f"--fault {words}: these are no parameters for it.") from error
