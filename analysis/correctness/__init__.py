"""`crosscheck`, `validate` and simulation-based calibration (`sbc`): whether all routes compute the same."""
