"""Synthetic recordings of an articulated body whose joints are known."""
