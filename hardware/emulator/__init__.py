"""Emulated devices on pseudo-terminals, with a switch for every fault a bench produces."""
