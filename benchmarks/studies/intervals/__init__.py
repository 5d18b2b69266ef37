"""Coverage of intervals, and level and power of the verdicts on beliefs and exponents.

Start with `coverage`; the others draw data sets in the same way. They update docs/explanation/intervals.md.
"""
