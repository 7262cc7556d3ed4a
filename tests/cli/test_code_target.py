import os
import platform
import subprocess
import sys

import pytest

COMMON = "('x86_64-unknown-linux-gnu', 'x86-64-v3', '')"
COMPILED_FOR = """
from numba.core.registry import cpu_target
print(cpu_target.target_context.codegen().magic_tuple())
"""


COMMAND = "from study.text import instruction_set\ninstruction_set.fix()\n"
LIBRARY = "from study.sphere.jit import total\nimport numpy, os\nbefore = dict(os.environ)\ntotal(numpy.ones(2))\n"
LIBRARY += "assert os.environ == before\n"
NUMBA_BEFORE = "import numba\nnumba.njit(lambda x: x)(1)\n"
X86 = pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="other processors have one kind of code")


def target(code):
    """Name and features of the processor that a program's code is generated for."""
    unset = {"NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "OPENBLAS_CORETYPE"}
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    command = [sys.executable, "-c", code + COMPILED_FOR]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=True).stdout.strip()


@X86
@pytest.mark.parametrize("code", [COMMAND, LIBRARY], ids=["command", "library"])
def test_compiled_code_knows_nothing_of_the_processor_at_hand(code):
    """Neither its name nor its features: with AVX-512 among them, the same run had other bytes elsewhere.

    A program that fits has the same code, without a change in its environment, so that one cache serves both.
    """
    assert target(code) == COMMON


@X86
def test_a_program_that_compiled_before_keeps_its_code():
    """Its functions, compiled before and after the first fit, are for the processor at hand."""
    assert target(NUMBA_BEFORE + LIBRARY) == target(NUMBA_BEFORE) != COMMON
