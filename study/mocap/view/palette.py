"""How skeletons look in figures, videos and the viewer: one colour per side of the body, one for what is doubtful."""

SIDES = {"left": "#0072b2", "right": "#c2580a", "": "#4a4a4a"}
"""Bones of the left, of the right, and between them."""
MARKER = "#7d8a94"
ELLIPSOID = "#009e73"
FLAGGED = "#c2187e"
"""A joint that is not to be relied on, always, or in this frame."""
FLOOR = "#dde2e6"
SHADOW = "#e9ecee"
