"""Serial ports, lines and rig time that stage and skin share.

Start with `port`, the only file that imports pySerial, and `loop`, which reads it. `stage` and `skin` decode the
bytes.
"""
