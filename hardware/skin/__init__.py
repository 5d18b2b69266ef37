"""Tactile skins: how frames of taxels arrive, what can be wrong with them, and how a tap is cut out.

Start with `skin`, what all can do; `fingertip` reads an iCub fingertip over CAN, `line_sensor` any board that prints
lines. Nothing here moves.
"""
