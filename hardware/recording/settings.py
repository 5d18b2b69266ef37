"""Rig and plan stored in a recording, and whether they allow it to be resumed."""

from importlib.metadata import version
from itertools import chain
from typing import Any

import msgspec
import numpy as np

from ...models.io.rig_recording import About
from ..rig.settings import RigFile
from .plan import Plan

_ELSEWHERE = ("settings.sensor.port", "settings.stage.port", "settings.emulator")
"""Settings that may change between two parts of a recording: the ports of the devices."""


def about_rig(rig: RigFile, text: str = "", plan: Plan | None = None) -> About:
    """Header of a recording.

    Args:
        rig: Settings of the rig.
        text: Text of the rig's file.
        plan: Plan of the collection, if any.
    """
    limits = rig.range
    edges = limits.start_mm + limits.cell_mm * np.arange(limits.where_classes + 1)
    kind = rig.sensor.device
    objects = [] if plan is None else plan.objects
    used = range(len(rig.sensor.positions_mm)) if rig.tap.taxels is None else rig.tap.taxels
    positions = [rig.sensor.positions_mm[k] for k in used] if rig.sensor.positions_mm else []
    return About(
        name=rig.name,
        sensor=f"emulated {kind}" if rig.emulator is not None else kind,
        settings=msgspec.to_builtins(rig),
        text=text,
        preprocessing=rig.preprocessing.to_json(),
        where_edges_mm=edges.tolist(),
        taxel_position_mm=list(chain.from_iterable(positions)),
        plan={} if plan is None else msgspec.to_builtins(plan),
        session=0 if plan is None else plan.session,
        objects=[entry.name for entry in objects],
        sizes_mm=[entry.size_mm for entry in objects if entry.size_mm is not None],
        software=version("solidtouch"),
    )


def differences(here: About, recorded: About) -> list[str]:
    """Differences of rig and plan from those of a recording, one phrase per key; ports are ignored."""
    new, old = _flat(here), _flat(recorded)
    keys = sorted(set(new) | set(old))
    return [
        f"{key} is {new.get(key, 'missing')} here and {old.get(key, 'missing')} in the recording"
        for key in keys
        if new.get(key) != old.get(key) and not key.startswith(_ELSEWHERE)
    ]


def _flat(about: About) -> dict[str, Any]:
    """All settings by full name, as JSON values; those that are not given, as `null`, are left out."""
    flat: dict[str, Any] = {}

    def put(name: str, value: Any) -> None:
        parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else None
        if parts is None and value is not None:
            flat[name] = value
        for key, part in parts or ():
            put(f"{name}.{key}" if isinstance(value, dict) else f"{name}[{key}]", part)

    content = msgspec.json.decode(msgspec.json.encode(about))
    put("settings", content["settings"])
    put("plan", content["plan"])
    return flat
