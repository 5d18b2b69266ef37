"""Active Bayesian perception for robot touch: object and position from taps.

Names are listed with their places in `__init__.pyi` and described in docs/reference/api.md. They are loaded when
they are first asked for, so that importing this package costs nothing.
"""

from importlib.metadata import version

import lazy_loader

__version__ = version("solidtouch")

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
