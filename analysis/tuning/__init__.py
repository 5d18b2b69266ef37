"""`tune`: fixation point and threshold from training taps, or learned on line.

Start at `report` and `online`, the public functions, then `run`. No search: `inference` holds the rules of choice.
"""
