"""`inspect`: sizes, ranges and data-quality warnings of a recording.

Start at `report`; `run` finds and `page` shows. No fits: a recording is inspected before any model is chosen.
"""
