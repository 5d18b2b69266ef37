"""`inspect`: sizes, ranges and data-quality warnings of a recording.

Start at `run`; `view` prints. No fits: a recording is inspected before any model is chosen.
"""
