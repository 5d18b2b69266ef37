"""The live view of an episode, and its picture."""
