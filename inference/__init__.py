"""From taps to beliefs, decisions and moves."""
