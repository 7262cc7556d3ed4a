"""Sphere estimators: `fit` calls one by name, `ESTIMATORS` lists them."""

from study.estimators.answer.fit import Fit
from study.estimators.answer.joint_fit import JointFit
from study.estimators.estimates import Estimates
from study.estimators.estimator import Estimator
from study.estimators.form.minimum_zone import MinimumZone, minimum_zone
from study.estimators.incremental import Incremental
from study.estimators.multi_marker import mgdk
from study.estimators.own.installed import load_installed
from study.estimators.own.register import register
from study.estimators.registry import ESTIMATORS, fit
from study.estimators.samples import Samples
from study.estimators.status import Status

__all__ = [
    "ESTIMATORS",
    "Estimates",
    "Estimator",
    "Fit",
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
