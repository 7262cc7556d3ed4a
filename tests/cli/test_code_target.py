import os
import platform
import subprocess
import sys

import pytest

COMPILED_FOR = """
from study.runs.workers import instruction_set
instruction_set.fix()
from numba.core.registry import cpu_target
print(cpu_target.target_context.codegen().magic_tuple())
"""


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="other processors have one kind of code")
def test_compiled_code_knows_nothing_of_the_processor_at_hand():
    """Neither its name nor its features: with AVX-512 among them, the same run had other bytes elsewhere."""
    unset = {"NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "OPENBLAS_CORETYPE"}
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    command = [sys.executable, "-c", COMPILED_FOR]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.strip() == "('x86_64-unknown-linux-gnu', 'x86-64-v3', '')"
