"""Anatomical axes of the synthetic body, straight from its table of places."""

import numpy as np

from study.recordings.synthetic.make import body, unit


def axes_of_the_body():
    """Anatomical axes of the synthetic body's segments in its own axes, straight from its table of places."""
    parts = {part.name: part for part in body("rizzoli")}
    place = {label: np.array(at) for part in parts.values() for label, at in part.markers.items()}

    def frame(**axes):
        (one, a), (two, b) = axes.items()
        a = np.array(a) / np.linalg.norm(a)
        c = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
        columns = {one: a, two: np.cross(c, a)}
        third = next(name for name in "xyz" if name not in axes)
        columns[third] = c if (one + two) in ("xy", "yz", "zx") else -c
        return np.stack([columns[name] for name in "xyz"], axis=1)

    asis = place["LIAS"] + place["RIAS"]
    result = {"pelvis": frame(z=place["RIAS"] - place["LIAS"], x=asis - place["LIPS"] - place["RIPS"])}
    for letter, one, sign in (("L", "left", -1), ("R", "right", 1)):
        lateral, medial = place[f"{letter}FLE"], place[f"{letter}FME"]
        result[f"{one}_thigh"] = frame(y=-(lateral + medial), z=sign * (lateral - medial))
        shank = parts[f"{one}_shank"]  # the knee is the point of its axis midway between the epicondyles
        knee = unit(shank.axis) * (unit(shank.axis) @ (0.5 * (lateral + medial) - np.array(shank.at)))
        lateral, medial = place[f"{letter}FAL"], place[f"{letter}TAM"]
        result[f"{one}_shank"] = frame(y=2 * knee - lateral - medial, z=sign * (lateral - medial))
        fifth, first = place[f"{letter}FM5"], place[f"{letter}FM1"]
        result[f"{one}_foot"] = frame(x=fifth + first - 2 * place[f"{letter}FCC"], z=sign * (fifth - first))
    return result
