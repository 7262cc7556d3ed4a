"""Sphere estimators: `fit` calls one by name, `ESTIMATORS` lists them."""

from study.fits.answers.answer import Fit, GivenFit
from study.fits.answers.markers import Incremental, JointFit, mgdk
from study.fits.evidence.form import MinimumZone, minimum_zone
from study.fits.points.samples import Estimates, Estimator, Samples, Status, blank
from study.fits.registry import ESTIMATORS, fit, load_installed, register

__all__ = [
    "ESTIMATORS",
    "Estimates",
    "Estimator",
    "Fit",
    "GivenFit",
    "Incremental",
    "JointFit",
    "MinimumZone",
    "Samples",
    "Status",
    "blank",
    "fit",
    "mgdk",
    "minimum_zone",
    "register",
]

load_installed()
