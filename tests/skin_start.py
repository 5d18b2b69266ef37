"""Starts a sensor as a rig does."""


def start(skin):
    """Starts the readings and measures the baseline; the port is closed again if either fails."""
    skin.listen()
    try:
        skin.monitor.measure_baseline()
    except BaseException:
        skin.stop()
        raise
