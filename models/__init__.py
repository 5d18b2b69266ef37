"""What is known before any tap: labelled taps, class grids and generative models."""
