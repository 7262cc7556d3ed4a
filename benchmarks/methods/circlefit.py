"""The fits of the package circle-fit, with their own names."""

import circle_fit

import study


def first(function, *more):
    """A function of circle-fit, whose answer begins with x, y and the radius."""

    def fit(points):
        x, y, radius, *_ = function(points, *more)
        return [x, y], radius

    return fit


def lm(points):
    """The geometric fit, from the answer of the algebraic one."""
    x, y, radius, _ = circle_fit.lm(points, circle_fit.taubinSVD(points)[:3])
    return [x, y], radius


NAMES = ("hyperLSQ", "standardLSQ", "riemannSWFLa", "prattSVD", "taubinSVD", "hyperSVD", "kmh")
for name in NAMES:
    study.register(f"circle_fit_{name.lower()}", first(getattr(circle_fit, name)), reference=f"circle-fit: {name}")
study.register("circle_fit_lm", lm, reference="circle-fit: lm")
