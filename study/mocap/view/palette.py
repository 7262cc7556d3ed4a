"""Colours of skeletons in figures, videos and the viewer: one per side of the body, and one for doubtful joints."""

SIDES = {"left": "#0072b2", "right": "#c2580a", "": "#4a4a4a"}
"""Bones of the left side, of the right side, and between them."""
MARKER = "#7d8a94"
ELLIPSOID = "#009e73"
FLAGGED = "#c2187e"
"""A joint that is not reliable, in all frames or in this one."""
FLOOR = "#dde2e6"
SHADOW = "#e9ecee"
GHOST = "#7a5fb5"
"""A second motion beside or over the first one."""
