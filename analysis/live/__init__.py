"""Live view of an episode, and its picture.

Start at `view`. No decisions: the view shows what an episode of `inference` reports.
"""
