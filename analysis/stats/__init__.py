"""Statistics that several studies share: intervals, pairing, reference distributions, reliability, effects."""
