"""`audit`: where samples, taxels and taps depend on each other, and what helps.

Start at `run`, then `checks` (what is measured), `remedies` (what helps) and `summary` (what is said).
No measurement models and no statistics that other studies need: those are in `models` and `analysis.stats`.
"""
