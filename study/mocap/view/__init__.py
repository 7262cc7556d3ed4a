"""Figures, videos and the interactive page of a skeleton."""
