"""`inspect`: sizes, ranges and data-quality warnings of a recording, and which questions it can answer.

Start at `report`; `run` finds, `questions` judges what the recording can show, and `page` shows.
No fits but a rough one (`quick_fit`): a recording is inspected before any model is chosen.
"""
