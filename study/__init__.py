"""Monte-Carlo study of closed-form sphere fits (Knight & Semwal 2009), and the fits themselves as a library.

    import study
    result = study.fit(points, "ugdk", noise=0.05)   # points (…, n, d)
    bound = study.crlb(directions, noise=0.05)       # (…, d+1, d+1)

The command line is `study --help`.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from study.estimators import ESTIMATORS, Estimator, Fit, Incremental, JointFit, Samples, Status, fit, mgdk
    from study.sphere.bounds import crlb

__version__ = "0.1.0"
__all__ = [
    "ESTIMATORS",
    "Estimator",
    "Fit",
    "Incremental",
    "JointFit",
    "Samples",
    "Status",
    "__version__",
    "crlb",
    "fit",
    "mgdk",
]


def __getattr__(name: str) -> Any:
    """Import the library on first use, so that `study --help` need not wait for it."""
    if name == "crlb":
        from study.sphere.bounds import crlb as found
    elif name in __all__:
        from study import estimators

        found = getattr(estimators, name)
    else:
        raise AttributeError(f"module 'study' has no attribute {name!r}")
    globals()[name] = found  # not asked for again: it would cost as much as a sum over a thousand samples
    return found
