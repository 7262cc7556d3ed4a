"""The sphere and the circle of pyransac3d, a RANSAC whose answer is that of its best three or four points."""

import random
from threading import Lock

import numpy as np
import pyransac3d

import study

ALONE = Lock()
"""Python's generator, which the package draws from, is one for all threads."""


def ransac(points, noise):
    """The circle or sphere with the most points within 3 σ, of 100 trials."""
    with ALONE:
        random.seed(1)
        return best(points, noise)


def best(points, noise):
    """The answer of the package."""
    if points.shape[1] == 3:
        center, radius, _ = pyransac3d.Sphere().fit(points, 3.0 * noise, 100)
        return center, radius
    flat = np.column_stack([points, np.zeros(len(points))])
    with np.errstate(all="ignore"):  # it divides by the differences of the coordinates
        center, _, radius, _ = pyransac3d.Circle().fit(flat, 3.0 * noise, 100)
    return center[:2], radius


study.register("pyransac3d", ransac, needs="noise", reference="pyransac3d: Circle and Sphere, 3 σ, 100 trials")
