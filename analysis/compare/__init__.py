"""`compare`: measurement models compared by prediction, classification and decision error.

Start at `run`, then `taps`, `classes` and `ranking`.
No model is defined here: the catalogue is in `models`.
"""
