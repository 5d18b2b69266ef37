"""Where taps come from: simulated and replayed rigs behind one protocol."""
