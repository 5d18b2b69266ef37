"""The variance of the evidence of taps, split by its causes.

Start at `split`, then `causes` and `suspects`. No remedies: `audit.remedies` tries them.
"""
