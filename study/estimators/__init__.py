"""Sphere estimators: `fit` calls one by name, `ESTIMATORS` lists them."""

from study.estimators.estimator import Estimator
from study.estimators.fit import Fit
from study.estimators.incremental import Incremental
from study.estimators.multi_marker import JointFit, mgdk
from study.estimators.own.installed import load_installed
from study.estimators.own.register import register
from study.estimators.registry import ESTIMATORS, fit
from study.estimators.samples import Samples
from study.estimators.status import Status

__all__ = ["ESTIMATORS", "Estimator", "Fit", "Incremental", "JointFit", "Samples", "Status", "fit", "mgdk", "register"]

load_installed()
