"""Recordings of an articulated figure whose joints are known."""
