"""The kit as a data set of its own: version, files, checksums, descriptions, and a reader of exported folders.

Start at `export`, then `pinned`. What cases and answers are stands in the folder above.
"""
