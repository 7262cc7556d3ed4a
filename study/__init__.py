"""Sphere and circle fits as a library, and the Monte-Carlo study of them (Knight & Semwal 2009).

    import study
    fit = study.fit(points)                         # points (…, n, d): fit.center, fit.radius, fit.interval("radius")
    fit = study.fit("scan.ply")                     # the points of a file; study.read_points chooses its columns
    joint = study.mgdk([marker_a, marker_b])        # points (n, d) of each marker: one common centre
    bound = study.crlb(directions, noise=0.05)      # (…, d+1, d+1)
    spheres = study.fit_spheres(points, 5)          # several in one cloud (n, d): spheres.center (k, d), spheres.labels
    circle = study.fit_circle(points)               # in space (n, 3): circle.center, circle.radius, circle.axis
    zone = study.minimum_zone(points)               # two concentric spheres that enclose all points most closely
    best = study.attainable_bound(45, noise=0.3)    # (d+1, d+1), for one sample on the unit sphere

    joints = study.find_joints("walk.c3d")          # the joints of a body, with errors and statuses: joints["left_hip"]
    skeleton = study.draw_skeleton("run.c3d", joints)   # skeleton.center("left_hip") (3, frames)

    errors = study.ask(50, 0.1, 40)                 # of each estimator, without a run: N, σ/r, angle of the cap
    run = study.run("mine.toml")                    # a study: run.errors, run.summary(angle=45), run.plot("fig_map")
    run = study.read_run("results/mine-21aa4797f5") # one that was run before

`study.ESTIMATORS` lists the estimators, `study.register` adds one of your own, `study.register_law` a law of noise or
of directions, `study.register_measure` a measure of fits, and `study.Incremental` fits points as they arrive. The
command line is `study --help`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from study.fits import (
        ESTIMATORS,
        Estimates,
        Estimator,
        Fit,
        GivenFit,
        Incremental,
        JointFit,
        MinimumZone,
        Samples,
        Status,
        fit,
        mgdk,
        minimum_zone,
        register,
    )
    from study.fits.errors.attainable import attainable_bound
    from study.fits.plan import plan_fit
    from study.fits.points.information import crlb
    from study.fits.points.point_files import PointTable, read_points
    from study.fits.space_circle import CircleFit, fit_circle
    from study.fits.spheres import CloudSpheres, fit_spheres
    from study.recordings.api import draw_skeleton, find_gait, find_joint, find_joints
    from study.recordings.formats.read import read_recording
    from study.recordings.recording import Recording
    from study.simulation.analysis.ask import ask
    from study.simulation.experiment.laws import register_law
    from study.simulation.experiment.measures import register_measure
    from study.simulation.library import StudyRun, read_run, run


__version__ = "2.0.0"
__all__ = [
    "ESTIMATORS",
    "CircleFit",
    "CloudSpheres",
    "Estimates",
    "Estimator",
    "Fit",
    "GivenFit",
    "Incremental",
    "JointFit",
    "MinimumZone",
    "PointTable",
    "Recording",
    "Samples",
    "Status",
    "StudyRun",
    "__version__",
    "ask",
    "attainable_bound",
    "crlb",
    "draw_skeleton",
    "find_gait",
    "find_joint",
    "find_joints",
    "fit",
    "fit_circle",
    "fit_spheres",
    "mgdk",
    "minimum_zone",
    "plan_fit",
    "read_points",
    "read_recording",
    "read_run",
    "register",
    "register_law",
    "register_measure",
    "run",
]

_PLACES = {
    "attainable_bound": "study.fits.errors.attainable",
    "crlb": "study.fits.points.information",
    "plan_fit": "study.fits.plan",
    **dict.fromkeys(["PointTable", "read_points"], "study.fits.points.point_files"),
    **dict.fromkeys(["CircleFit", "fit_circle"], "study.fits.space_circle"),
    **dict.fromkeys(["CloudSpheres", "fit_spheres"], "study.fits.spheres"),
    "Recording": "study.recordings.recording",
    "read_recording": "study.recordings.formats.read",
    **dict.fromkeys(["draw_skeleton", "find_gait", "find_joint", "find_joints"], "study.recordings.api"),
    "ask": "study.simulation.analysis.ask",
    "register_law": "study.simulation.experiment.laws",
    "register_measure": "study.simulation.experiment.measures",
    **dict.fromkeys(["StudyRun", "read_run", "run"], "study.simulation.library"),
}
"""Modules of the names that `study.fits` does not define."""


def __getattr__(name: str) -> Any:
    """Import the library on first use, so that `study --help` need not wait for it."""
    if name not in __all__:
        remedy = ""
        if not name.startswith("_"):  # Python itself asks for such names
            words = import_module("study.words")
            remedy = f": {words.name_remedy(name, __all__)}"
        raise AttributeError(f"module 'study' has no attribute {name!r}{remedy}")
    value = getattr(import_module(_PLACES.get(name, "study.fits")), name)
    globals()[name] = value  # or each use would come here, which costs as much as a sum over a thousand samples
    return value


def __dir__() -> list[str]:
    """The public names, which are offered before they are imported."""
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
