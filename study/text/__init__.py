"""The ground: aligned columns, numbers in few digits, the nearest known name; and the instructions of compiled code."""
