"""Which machine instructions code is generated for. Nothing heavy is imported: it must be known before numba is."""

import os
import platform
from pathlib import Path

_NAMES = ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "OPENBLAS_CORETYPE")


def fix() -> None:
    """Generate the same machine code on every x86-64 processor since 2013, so that equal runs are equal to the byte.

    The default is code for the processor at hand, whose wider registers add in another order; a name alone would
    leave its features in. It must be set before numba is imported; a user's own choice stands.
    """
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
    """What the environment says of it, for another process."""
    return {name: os.environ[name] for name in _NAMES if name in os.environ}
