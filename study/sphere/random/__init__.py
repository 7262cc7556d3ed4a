"""Random numbers inside compiled loops: NumPy's own, to the bit."""
