"""Sphere estimators: `fit` calls one by name, `ESTIMATORS` lists them."""

from study.fits.answer import Fit, GivenFit
from study.fits.form import MinimumZone, minimum_zone
from study.fits.markers import Incremental, JointFit, mgdk
from study.fits.registry import ESTIMATORS, fit, load_installed, register
from study.fits.samples import Estimates, Estimator, Samples, Status

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
    "fit",
    "mgdk",
    "minimum_zone",
    "register",
]

load_installed()
