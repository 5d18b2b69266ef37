"""Shared by commands: options, progress, Ctrl-C, opening sensors, showing an episode.

Start with `options`. No command is defined here.
"""
