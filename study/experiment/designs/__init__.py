"""The two designs, a grid and a random one: their entries in a config, their cells, and the draws of these."""
