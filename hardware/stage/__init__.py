"""The positioning stage: G-code to a GRBL controller, its states, faults and limits.

Start with `stage`, then `grbl`, the protocol. When and where to move is decided elsewhere.
"""
