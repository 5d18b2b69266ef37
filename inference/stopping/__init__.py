"""Stopping rules: when to decide.

Start with `stopping`: the interface, the paper's threshold and other rules; `rules` names them all.
"""
