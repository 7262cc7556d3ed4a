"""Machine instructions that code is generated for, the same for commands and library. Little is imported here."""

import os
import platform
import re
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

_PROCESSOR, _FEATURES = "x86-64-v3", ""
"""LLVM's name of every x86-64 processor since 2013, and features: those that the name implies, and no others."""
_WIDER = "X86_V4 AVX512_ICL AVX512_SPR"
"""Wider instructions by NumPy's names, from its version 2.4 on: logarithms and powers have other last bits there."""
_WIDER_BEFORE = "AVX512F AVX512CD AVX512_KNL AVX512_KNM AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL"
"""Names of versions 1.26 to 2.3. NumPy warns of names that it does not know, not of those that the processor lacks."""


def fix() -> None:
    """Run the same machine code on every x86-64 processor since 2013, so that equal runs are equal to the byte.

    By default, code is generated, or chosen by NumPy and OpenBLAS, for the processor at hand, whose wider registers add
    in another order; a name alone would leave its features in. Linear algebra gets one thread, because the matrices
    here are small: two threads took seven times as long. Commands call this before numba and NumPy are imported. A
    setting that the user made stands.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if _is_common():
        os.environ["NUMBA_CPU_NAME"], os.environ["NUMBA_CPU_FEATURES"] = _PROCESSOR, _FEATURES
        os.environ.setdefault("OPENBLAS_CORETYPE", "Haswell")
        os.environ.setdefault("NPY_DISABLE_CPU_FEATURES", _WIDER if _numpy() >= (2, 4) else _WIDER_BEFORE)


def fix_compiler() -> None:
    """Generate that code in a program that uses the library, so that it takes what a command compiled, and reverse.

    The program's environment, which others read, stays as it is. Numba has one kind of code in a process: where the
    program has compiled functions of its own before, that of the processor at hand, also for the loops. Nothing public
    of numba says whether it has: without the private ``cpu_target`` such a program would get code of both kinds.
    """
    from numba.core.registry import cpu_target

    config: Any = import_module("numba").config

    if _is_common() and "_toplevel_target_context" not in vars(cpu_target):  # numba has not chosen yet
        config.CPU_NAME, config.CPU_FEATURES = _PROCESSOR, _FEATURES


def _numpy() -> tuple[int, int]:
    """NumPy's version, from its file: to load `importlib.metadata` takes a seventh of `study --help`."""
    place = find_spec("numpy")
    assert place is not None
    assert place.origin is not None
    text = Path(place.origin).with_name("version.py").read_text(encoding="utf-8")
    major, minor = re.findall(r'^version = "(\d+)\.(\d+)', text, re.MULTILINE)[0]
    return int(major), int(minor)


def _is_common() -> bool:
    """Tell whether the processor has the common instructions, and the user asks for no others."""
    if platform.machine() not in ("x86_64", "AMD64") or "NUMBA_CPU_NAME" in os.environ:
        return False
    try:
        flags = set(Path("/proc/cpuinfo").read_text(encoding="utf-8").split())
    except OSError:
        return False
    return {"avx2", "fma", "bmi2"} <= flags
