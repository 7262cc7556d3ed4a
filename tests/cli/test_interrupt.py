"""A run that is interrupted: code 130, one line, finished parts kept, and running again finishes it."""

import os
import signal
import subprocess
import time

import pytest

from study.runs.storage.parts import Parts

# 200 units of 8 million samples: minutes of work, of which the first second is done
LONG = """name = "long"
seed = 1
estimators = ["lls"]
[design]
kind = "grid"
trials = 200_000
samples = 1000
noise = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]
angle = 90
"""


def _take_interrupts():
    """Undo what a shell does to programs that it starts in the background, and they to theirs: ignore Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send to another process")
@pytest.mark.parametrize(
    ("backend", "jobs", "number"),
    [("threads", 1, signal.SIGINT), ("threads", 2, signal.SIGTERM), ("loky", 2, signal.SIGINT)],
)
def test_interrupt(command, tmp_path, backend, jobs, number):
    """Ctrl-C and SIGTERM end a run with code 130 and one line; its parts are whole, temporary files are gone."""
    words, environment = command
    (tmp_path / "long.toml").write_text(LONG)
    process = subprocess.Popen(
        [*words, "run", "long.toml", "--out", "out", "--jobs", str(jobs), "--backend", backend],
        cwd=tmp_path,
        env=environment,
        preexec_fn=_take_interrupts,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
    )
    parts = tmp_path / "out" / "parts"
    try:
        for _ in range(10_000):
            if process.poll() is not None or (parts.is_dir() and any(parts.glob("[!.]*.part"))):
                break
            time.sleep(0.02)
        assert process.poll() is None, process.communicate()
        process.send_signal(number)
        said, complained = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert said == ""
    kept = Parts(tmp_path / "out", "units")
    kept.load()
    assert kept.count == len(list(parts.iterdir())) > 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["config.toml", "parts"]
    assert complained.splitlines() == ["interrupted; run the same command again to resume"]
