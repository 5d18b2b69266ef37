"""A first look at files of any layout: what they hold, which roles their arrays may have, and a map to begin with.

`look` is the way in; `beside` says which files are the recording, `opening` how its tables are written;
`guess_columns` (with `guess_presses`), `guess_arrays` and `guess_names` judge columns, arrays and names, by the words
in `guess`.
"""
