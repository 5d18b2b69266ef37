"""What is said of passive and active perception at one threshold."""

import xarray as xr
from solidtouch.analysis.reproduce.headline import STILL, still


def curves(passive, active):
    return {
        name: xr.Dataset({"taps": ("theta", [taps])}, {"theta": [0.95]})
        for name, taps in (("passive", passive), ("active", active))
    }


def test_a_sentence_where_nothing_can_differ():
    """Below the limit for both policies; certain only where nobody took a second tap."""
    assert still(curves(1.0, 1.0)).endswith("cannot differ.")
    assert "take 1.04 taps on average" in still(curves(1.04, 1.02))
    assert still(curves(1.04, 1.02)).endswith("can hardly differ.")
    assert still(curves(STILL, 1.0)) is None
    assert still(curves(1.0, STILL + 0.5)) is None
    assert still({"passive": curves(1.0, 1.0)["passive"]}) is None
