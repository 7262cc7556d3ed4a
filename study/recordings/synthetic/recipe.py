"""The settings of a synthetic recording."""

from dataclasses import dataclass, field

_LIMITS = {
    "frames": (2, 10**7),
    "rate": (1, 1e5),
    "seed": (0, 2**63),
    "noise": (0, 10),
    "soft_tissue": (0, 10),
    "gaps": (0, 1),
    "swaps": (0, 1),
    "height": (0.1, 10),
    "reach": (0, 1),
}
"""Least and greatest value of each number."""
SKIN = ("mixed", "random", "angle", "velocity", "cluster")
"""Laws by which the skin moves the markers; see `skin_motion`."""


@dataclass(frozen=True)
class Recipe:
    """The settings of a synthetic recording; `study synthetic` has an option for each, with the help given here.

    Raises:
        RecordingError: if a number is outside of its limits, ``skin`` is no law, or both ``independent`` and ``gait``.
    """

    frames: int = field(default=3000, metadata={"help": "number of frames"})
    rate: float = field(default=120.0, metadata={"help": "frames per second"})
    seed: int = field(default=1, metadata={"help": "seed of all random numbers"})
    noise: float = field(default=0.001, metadata={"help": "standard deviation of a marker's coordinate, metres"})
    soft_tissue: float = field(default=0.0, metadata={"help": "largest soft-tissue artefact of a marker, metres"})
    skin: str = field(default="mixed", metadata={"help": f"law of the soft-tissue artefact: {', '.join(SKIN)}"})
    gaps: float = field(default=0.0, metadata={"help": "share of each marker's samples that are missing"})
    swaps: float = field(default=0.0, metadata={"help": "share of the frames in which two markers are exchanged"})
    height: float = field(
        default=1.75, metadata={"help": "height of the body, metres; another height gives another subject"}
    )
    reach: float = field(default=1.0, metadata={"help": "share of the natural range of motion"})
    independent: bool = field(default=False, metadata={"help": "draw each frame anew instead of a smooth motion"})
    gait: bool = field(
        default=False, metadata={"help": "move as in walking: in strides, little out of the sagittal plane"}
    )

    def __post_init__(self) -> None:
        from study.recordings.recording import RecordingError  # the command line loads this file, but not numpy

        for name, (low, high) in _LIMITS.items():
            if not low <= (value := getattr(self, name)) <= high:
                raise RecordingError(f"{name} = {value:g} of a synthetic body must be from {low:g} to {high:g}")
        if self.skin not in SKIN:
            raise RecordingError(f"skin = {self.skin} of a synthetic body must be one of {', '.join(SKIN)}")
        if self.independent and self.gait:
            raise RecordingError("independent and gait of a synthetic body exclude each other; choose one")
