"""Files in and out: recordings in every format that can be read, and fitted models.

Start with `load`, which finds the reader for a file, and `recording`, what all readers make. `model_file` writes and
reads models, `export` writes them for other programs. What a model means stands in `measurement`.
"""
