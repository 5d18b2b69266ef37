"""Input and output: recordings in all supported formats, and fitted models.

Start with `load`, which selects the reader for a file, and `recording`, the result of all readers. `model_file` writes
and reads models, `export` writes them for other programs. Models are defined in `measurement`.
"""
