"""Machine instructions that code is generated for. They must be set before numba is loaded, so little is imported."""

import os
import platform
from pathlib import Path

_NAMES = ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "OPENBLAS_CORETYPE")


def fix() -> None:
    """Generate the same machine code on every x86-64 processor since 2013, so that equal runs are equal to the byte.

    By default, code is generated for the processor at hand, whose wider registers add in another order; a name alone
    would leave its features in. Linear algebra gets one thread, because the matrices here are small: two threads took
    seven times as long. Call this before numba and NumPy are imported. A setting that the user made stands.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if platform.machine() not in ("x86_64", "AMD64") or "NUMBA_CPU_NAME" in os.environ:
        return
    try:
        flags = set(Path("/proc/cpuinfo").read_text(encoding="utf-8").split())
    except OSError:
        return
    if {"avx2", "fma", "bmi2"} <= flags:
        os.environ["NUMBA_CPU_NAME"] = "x86-64-v3"
        os.environ["NUMBA_CPU_FEATURES"] = ""  # those that the name implies, and no others
        os.environ.setdefault("OPENBLAS_CORETYPE", "Haswell")


def environment() -> dict[str, str]:
    """Environment variables that another process needs for the same instructions."""
    return {name: os.environ[name] for name in _NAMES if name in os.environ}
