"""The variance of the evidence of taps, split by its causes."""
