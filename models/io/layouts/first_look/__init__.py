"""A first look at files of any layout: what they hold, which roles their arrays may have, and a map to begin with.

`look` is the way in; `guess`, `guess_arrays` and `guess_names` judge columns, arrays and names of files.
"""
