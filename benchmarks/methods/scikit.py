"""The circles and spheres of scikit-image, scikit-guess and scikit-spatial; RANSAC is given the noise."""

import numpy as np
from skimage.measure import CircleModel, ransac
from skspatial.objects import Circle, Sphere

import study

vars(np).setdefault("float_", np.float64)  # the name that scikit-guess 0.0.2 asks for
from skg import nsphere_fit


def circle_model(points):
    """The fit of CircleModel: algebraic least squares."""
    model = CircleModel.from_estimate(points)
    return model.center, model.radius


def ransac_circle(points, noise):
    """The circle of RANSAC with the most points within 3 σ, of 100 trials, fitted to these."""
    model, _ = ransac(points, CircleModel, min_samples=3, residual_threshold=3.0 * noise, max_trials=100, rng=1)
    return model.center, model.radius


def spatial(points):
    """The circle or sphere of scikit-spatial: algebraic least squares."""
    found = (Circle if points.shape[1] == 2 else Sphere).best_fit(points)
    return found.point, found.radius


study.register("skimage", circle_model, reference="scikit-image: CircleModel")
study.register("skimage_ransac", ransac_circle, needs="noise", reference="scikit-image: ransac, 3 σ, 100 trials")
study.register("skg", lambda points: nsphere_fit(points)[::-1], reference="scikit-guess: nsphere_fit")
study.register("skspatial", spatial, reference="scikit-spatial: best_fit")
