"""Independent tasks of studies, on threads or processes of this machine or on a Dask cluster.

Start with `crew.py`, which studies use, and `task.py`. Nothing that knows a study comes in.
"""
