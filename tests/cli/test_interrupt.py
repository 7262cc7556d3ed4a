"""A run that is interrupted: code 130, one line, finished parts kept, and running again finishes it."""

import os
import signal
import subprocess
import time

import pyarrow.parquet as pq
import pytest

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
@pytest.mark.parametrize("jobs", [1, 2])
def test_interrupt(command, tmp_path, jobs):
    """Ctrl-C ends a run with code 130 and one line; parts written before are whole, temporary files are gone."""
    words, environment = command
    (tmp_path / "long.toml").write_text(LONG)
    process = subprocess.Popen(
        [*words, "run", "long.toml", "--out", "out", "--jobs", str(jobs)],
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
            if process.poll() is not None or (parts.is_dir() and any(parts.glob("[!.]*.parquet"))):
                break
            time.sleep(0.02)
        assert process.poll() is None, process.communicate()
        process.send_signal(signal.SIGINT)
        said, complained = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert said == ""
    kept = list(parts.iterdir())
    assert kept
    assert all(pq.read_table(path).num_rows > 0 for path in kept)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["config.toml", "parts"]
    assert complained.splitlines() == ["interrupted; the parts that were finished are kept"]
