"""Recordings as they are published: a map says where samples and labels stand in files of any layout.

Start with `mapping.py`, the map itself; `formats/` opens the files, `first_look/` shows what they hold, `pieces.py`,
`assemble.py` and `tap_set.py` make taps of them.
What this software writes itself is read beside this folder, in `models/io`.
"""
