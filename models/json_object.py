"""Files that contain one JSON object, such as settings and exported models."""

import json
from pathlib import Path
from typing import Any, cast

from .errors import InputError


def read_object(path: str | Path, called: str) -> dict[str, Any]:
    """Object read from a JSON file.

    Args:
        path: The file.
        called: Expected content, for messages, such as `"setting"`.

    Raises:
        InputError: The file is missing, unreadable or not a JSON object, or a key is repeated.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file.")
    try:
        values = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=_once)
    except OSError as error:
        raise InputError(f"{path}: cannot read: {error.strerror}.") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not a valid {called} file: not JSON.") from error
    if not isinstance(values, dict):
        raise InputError(f"{path}: not a valid {called} file: not a JSON object.")
    return cast("dict[str, Any]", values)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    names = [name for name, _ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"repeated key {name}.")
    return dict(pairs)
