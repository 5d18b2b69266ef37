"""Tactile skins: protocols, drivers and checks of the readings.

Start with `skin`, the common interface; `fingertip` reads an iCub fingertip over CAN, `line_sensor` any board that
prints lines. Nothing here moves.
"""
