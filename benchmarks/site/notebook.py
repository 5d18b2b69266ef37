"""Notebooks of docs/notebooks, plain scripts, as MyST-NB reads them."""

from typing import Any

import jupytext

KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}


def read(text: str) -> Any:
    """A notebook from a script in the percent format."""
    notebook = jupytext.reads(text, fmt="py:percent")
    notebook.metadata["kernelspec"] = KERNEL
    notebook.metadata["language_info"] = {"name": "python", "pygments_lexer": "ipython3"}
    return notebook
