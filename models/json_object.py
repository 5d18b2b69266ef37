"""Files that hold one JSON object, as settings and exported models do."""

import json
from pathlib import Path
from typing import Any, cast

from .errors import InputError


def read_object(path: str | Path, called: str) -> dict[str, Any]:
    """The object in a JSON file.

    Args:
        path: The file.
        called: What it should be, for messages, such as `"setting"`.

    Raises:
        InputError: The file is missing, cannot be read or is something else, or a key stands there twice.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path} does not exist.")
    try:
        values = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=_once)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from error
    except InputError as error:
        raise InputError(f"{path} has {error}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is no {called}: it is not JSON.") from error
    if not isinstance(values, dict):
        raise InputError(f"{path} is no {called}: it holds no JSON object.")
    return cast("dict[str, Any]", values)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    names = [name for name, _ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"the key {name} twice.")
    return dict(pairs)
