"""Active Bayesian perception for robot touch: object and position from taps.

Names are listed with their places in `__init__.pyi` and described in docs/reference/api.md. They are loaded when
they are first asked for, so that importing this package costs nothing.
"""

from typing import Any

import lazy_loader

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415 - takes longer than all else here

        return version(__name__)
    return _public(name)
