"""Provenance of a run's numbers: versions, commit, machine, threads."""

import hashlib
import os
import platform
import subprocess
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from threadpoolctl import threadpool_info

import study

_HOME = Path(__file__).parents[2]
_COMPUTING = ("arrays.py", "fits/**/*.py", "simulation/experiment/**/*.py", "simulation/statistics.py")
"""Sources that numbers depend on, as patterns of paths in the package."""
_PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "pandas", "pyarrow", "joblib", "matplotlib")
"""Libraries that numbers and pictures depend on."""
_PATIENCE = 10.0
"""Seconds to wait for git."""


@cache
def software() -> dict[str, object]:
    """The versions and the code, which determine the bytes of a run besides its config; as at the first call."""
    return {
        "study": study.__version__,
        "commit": _git("rev-parse", "HEAD"),
        "dirty": bool(_git("status", "--porcelain", "--untracked-files=no")),
        **swhids(),
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in _PACKAGES},
        "code_generated_for": os.environ.get("NUMBA_CPU_NAME", "native"),
    }


def swhids() -> dict[str, str | None]:
    """Software Heritage identifiers of the commit and of its tree; None outside of a checkout.

    They are git's own hashes. A checkout with changes that are not committed has no other ones.

    Source: ISO/IEC 18670:2025, SWHID.
    """
    commit, tree = _git("rev-parse", "HEAD"), _git("rev-parse", "HEAD^{tree}")
    return {"revision": f"swh:1:rev:{commit}" if commit else None, "directory": f"swh:1:dir:{tree}" if tree else None}


def described(software: Mapping[str, object]) -> str:
    """Version and commit in words."""
    commit = software.get("commit")
    words = f"version {software.get('study', 'unknown')}" + (f", commit {str(commit)[:10]}" if commit else "")
    return words + (" with changes" if software.get("dirty") else "")


def other_version(made: Mapping[str, object]) -> str | None:
    """Warning about what another version of this program made; None if this one made it, or that is not known."""
    if not made or (made.get("study"), made.get("commit")) == (study.__version__, _git("rev-parse", "HEAD")):
        return None
    return f"made by {described(made)}; this is {described(software())}, whose numbers may differ"


def fingerprint() -> dict[str, str | None]:
    """Everything in this process that determines the bytes of an error table besides its config."""
    import llvmlite.binding
    import numpy  # loads the linear algebra whose kernels are listed
    from numba import config

    sources = sorted(path for place in _COMPUTING for path in _HOME.glob(place))
    blas = {str(pool.get("architecture")) for pool in threadpool_info() if pool["user_api"] == "blas"}
    return {
        "study": study.__version__,
        "sources": hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:12],
        **{name: _version(name) for name in ("numpy", "scipy", "numba", "llvmlite", "emcee")},
        "code generated for": getattr(config, "CPU_NAME", None) or llvmlite.binding.get_host_cpu_name(),
        "NumPy code for": ", ".join(numpy.show_config(mode="dicts")["SIMD Extensions"].get("found", [])),
        "BLAS kernels for": ", ".join(sorted(blas)),
    }


def differences(wanted: Mapping[str, str | None]) -> list[str]:
    """Differences of this process from another one's `fingerprint`, in words; none if it computes the same bytes."""
    mine = fingerprint()
    return [f"{name} {mine.get(name)} instead of {value}" for name, value in wanted.items() if mine.get(name) != value]


def machine() -> dict[str, object]:
    """The machine and its threads, which determine the seconds of a run."""
    return {
        "system": platform.platform(terse=True),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "threads": {pool["internal_api"]: pool["num_threads"] for pool in threadpool_info()},
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _git(*arguments: str) -> str | None:
    """Output of a git command in the package's own checkout; None outside of one."""
    root = Path(__file__).resolve().parents[3]
    if not (root / ".git").exists():
        return None
    try:
        done = subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, timeout=_PATIENCE)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())
