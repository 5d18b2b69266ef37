"""Whether classes are inferred without touch. Start at `run`."""
