"""From streams of frames to taps of one length: resampling, triggers, presses, taxels that are left out.

Begin with `tap_cutter`, which runs at the rig as well; `io.streams` applies it to recordings. No files are read here.
"""
