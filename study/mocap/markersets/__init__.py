"""Marker sets: which markers sit on which segment, and the joints between segments."""
