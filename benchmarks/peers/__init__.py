"""Checks from outside: scikit-learn's checks of estimators, examples of peers, `validate` in a fresh installation.

Start with `examples.py`, what peers publish, and `paths.py`, how it becomes taps of this project.
Nothing in the package imports from here; tests use it.
"""
