"""Geometric fits: those formed from the distances of the samples from the centre, by compiled passes over them."""
