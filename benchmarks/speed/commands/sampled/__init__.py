"""Sampling of where a process spends its processor time.

Python imports `sitecustomize` by itself at its start if this folder is in `PYTHONPATH`.
"""
