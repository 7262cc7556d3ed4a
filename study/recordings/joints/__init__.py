"""Joint centres from the poses of two segments."""
