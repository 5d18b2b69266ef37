"""Positioning stage: driver and protocol of a GRBL controller, its states, faults and limits.

Start with `stage`, then `grbl`, the protocol. Decisions when and where to move are made elsewhere.
"""
