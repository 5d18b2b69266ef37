"""Recordings as they are published: a map says where samples and labels stand in files of any layout.

Start with `mapping.py`, the map itself; `formats/` opens the files, `labels.py` and `assemble.py` make taps of them.
What this software writes itself is read beside this folder, in `models/io`.
"""
