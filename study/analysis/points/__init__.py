"""A user's own points: read from files, fitted, and the fits printed for people and for programs."""
