"""Synthetic recordings of bodies whose joints are known."""
