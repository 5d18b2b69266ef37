"""The variance of the evidence of taps, split by its causes.

Start at `split`, then `causes`, `suspects` and `gains`. No remedies: `audit.remedies` tries them.
"""
