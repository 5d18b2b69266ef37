"""Coverage of intervals, and level and power of the verdicts on beliefs and exponents.

Start with `coverage`; the others draw data sets as it does. They fill docs/explanation/intervals.md.
"""
