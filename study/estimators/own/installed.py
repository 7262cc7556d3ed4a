"""Estimators of installed packages, which name them in the entry-point group ``study.estimators``."""

import hashlib
import warnings
from importlib.metadata import entry_points

from study.estimators.estimator import Estimator
from study.estimators.own.register import Origin, add
from study.estimators.own.simple_form import SimpleForm, one_line

GROUP = "study.estimators"


def load_installed() -> None:
    """Register the estimators of installed packages.

    An entry point leads to a function of the simple form, or to a `study.Estimator`; its name is the estimator's. One
    that cannot be loaded is left out, with a warning of one line: it must not cost the others.
    """
    for point in entry_points(group=GROUP):
        package = f"{point.dist.name} {point.dist.version}" if point.dist is not None else point.value
        try:
            found = point.load()
            entry = found if isinstance(found, Estimator) else Estimator(SimpleForm(found))
            add(point.name, entry, Origin(package, hashlib.sha256(package.encode()).hexdigest()))
        except (Exception, SystemExit) as error:
            warnings.warn(f"estimator {point.name!r} of {package} is left out: {one_line(error)}", stacklevel=2)
