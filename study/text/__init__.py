"""Text for people: aligned columns, numbers in few digits, and the nearest known name."""
