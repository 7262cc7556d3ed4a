"""Commands that fail: exit code 1 or 2, a plain message on standard error, no traceback, and nothing written.

Interrupted runs end with code 130 and one line, and keep the finished parts; killed ones leave no workers. Standard
output that is full, closed or read by nobody ends a command quietly; so do names that are not UTF-8.

Noise that is not normal, on the command line: every text that has the bound names its law.
"""

import os
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

import study
from study import cli
from study.files import writing
from study.fits import registry
from study.simulation.runs.parts import FORMAT, Parts
from study.simulation.runs.run_folder import Run
from study.simulation.runs.workers import interrupts_later
from study.toml import ConfigError

LOOP = "import study\ndef loop(points):\n    while True: pass\nstudy.register('loop', loop)\n"

SCATTER = "case-study-scatter.parquet"

POINTS = "x,y,z\n1,0,0\n0,1,0\n-1,0,0\n0,-1,0\n0,0,1\n0.6,0,-0.8\n"

PRECISION = "[precision]\nrelative_target = 0.08\nfirst = 100\n"

POSTERIOR = '[posterior]\ntrials = 2\nwalkers = 16\nmax_steps = 100\nwhere = { samples = 20 }\nnoise = "known"\n'


@pytest.fixture(scope="module")
def folder(finished, config, tmp_path_factory):
    """A folder with a finished run in ``out``, one that is half there, one of posteriors, configs and points."""
    folder = tmp_path_factory.mktemp("mistakes")
    shutil.copytree(finished[0] / "out", folder / "out")
    shutil.copytree(finished[0] / "out", folder / "odd")
    (folder / "odd" / "manifest.json").unlink()
    apart = "where = { noise = 0.1, noise_over_radius = 0.01, samples = 20 }"
    texts = {
        "tiny.toml": config,
        "bad.toml": config.replace("trials = 5", "trials = 0").replace("= 90", "= 190"),
        "other.toml": config.replace("seed = 1", "seed = 2"),
        "need.toml": config.replace("tiny", "need").replace("trials = 5", "trials = 400") + PRECISION,
        "where.toml": config + POSTERIOR.replace("samples = 20", "samples = 21"),
        "coope.toml": config.replace("lls", "coope"),
        "raises.py": "raise RuntimeError('no')",
        "taken.py": "import study\nstudy.register('als', len)",
        "mine.py": "import study\nstudy.register('mine', len)",
        "half/config.toml": config.replace("tiny", "half"),
        "chains/config.toml": config + POSTERIOR,
        "chains/parts": "in the way",
        "apart/config.toml": config + POSTERIOR.replace("where = { samples = 20 }", apart),
        "cap.csv": POINTS,
        "bad.csv": "x,y\n1,2\n3,four\n5,6\n7,8\n",
        "timed.csv": "\n".join(f"{i},1,{i * i},{i % 3}" for i in range(9)),
        "none.csv": "a,b\n1,2\n",
        f"scatter/{SCATTER}": "not parquet",
        "file": "mine",
        "folder.csv/file": "mine",
        "closed/file": "mine",
        "odd/manifest.json/file": "mine",
    }
    for name, text in texts.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    return folder


NO_RUN = "not a run folder"
UNKNOWN = "neither a file nor a shipped config"
TRIAL = "give a cell and the number of a trial, or both as CELL/TRIAL"
PLUGINS = {
    "raises.py": "line 1: RuntimeError: no",
    "taken.py": "line 2: ValueError: register('als'): the name is taken",
    "mine.py": "mine: fails on 20 sound points: TypeError: ",
}
KINDS = "give a name that ends in .csv or .parquet"

REFUSED = {
    # folders of runs
    **{f"{verb} none": (1, f"none: {NO_RUN}") for verb in ("status", "worst", "posterior", "report", "regret")},
    **{f"{verb} file": (1, f"file: {NO_RUN}") for verb in ("status", "worst", "summary")},
    **{f"{verb} .": (1, f".: {NO_RUN}") for verb in ("status", "worst", "posterior")},
    "summary .": (1, f".: {NO_RUN} ... study run CONFIG"),
    "summary none": (1, f"none: {NO_RUN} ... study run CONFIG"),
    "summary need.toml": (1, f"results/need- ... {NO_RUN} ... study run CONFIG"),
    "summary smoke": (1, f"results/smoke- ... {NO_RUN}"),
    "summary half": (1, "half/summary.parquet: missing ... study run half/config.toml"),
    "run other.toml --out out": (1, "out: holds a run of another config ... tiny- ... --out"),
    "run tiny.toml --out tiny.toml/out": (1, "tiny.toml/out: cannot be written: Not a directory"),
    "merge tiny.toml": (1, "results/tiny- ... no share of it is stored; `study run CONFIG --part 1/N` computes the"),
    "merge tiny.toml out": (1, "out: holds no share of a run; `study run CONFIG --part K/N` makes one"),
    "run tiny.toml --part 1/2 --out out": (1, "out: holds a run, and no share of one; choose another folder with --"),
    **dict.fromkeys(["run need.toml --part 1/2", "merge need.toml"], (1, "need- ... [precision] decides by all rows")),
    "diff out none": (1, f"none: {NO_RUN}"),
    "worst out -e mle": (1, "out: no estimator 'mle' in this run; known are lls, ugdk"),
    # configs
    "summary none.toml": (2, "none.toml: cannot be read"),
    **{f"{verb} none.toml": (2, "none.toml: ... No such file or directory") for verb in ("run", "plan")},
    "plan papre": (2, f"papre: {UNKNOWN}; did you mean 'paper'? Known are anisotropic, "),
    **{f"{verb} bad.toml": (2, "bad.toml: 2 faults ... trials = 0 ... angle = 190", 3) for verb in ("run", "plan")},
    "run where.toml": (2, "where.toml: 1 fault\n  line 14: posterior.where: no cell has samples = 21\n", 2),
    "run coope.toml": (2, "coope.toml: 1 fault ... estimators =  ... 'coope' unknown", 2),
    # summaries, reports and figures
    "regret out --csv regret.txt": (1, f"regret.txt ... {KINDS}"),
    "regret out --csv cap.csv/below.csv": (1, "cap.csv/below.csv: cannot be written: "),
    "report out .": (1, f".: {NO_RUN}"),
    "report half": (1, "half/errors.parquet: missing; finish the run with `study run half/config.toml --out half`"),
    "report out half": (1, "half/errors.parquet: missing"),
    "report out out": (1, "out and out: both are runs named 'tiny'"),
    "report out --out out": (1, "out: cannot be written: Is a directory"),
    "report out --out other.toml/page.html": (1, "other.toml/page.html: cannot be written"),
    "report out --cost none.parquet": (1, "none.parquet: no cost table"),
    "report out --readings none.csv": (1, "none.csv: no table of readings: needs the columns choice, reading, "),
    "readings raedings": (2, "raedings:  ... did you mean 'readings'"),
    "figures out fig2_error --out file": (1, "file: is a file, not a folder; choose another with --out"),
    "figures out fig2_error --out file/below": (1, "file/below: cannot be"),
    # case studies
    **{f"{verb} out --recording none": (2, "none: not the folder of a case study") for verb in ("claims", "report")},
    **{f"{verb} out --recording scatter": (2, f"scatter/{SCATTER}: cannot be read") for verb in ("claims", "report")},
    # posteriors
    "posterior out": (1, "out: its config has no [posterior] ... configs/posterior.toml"),
    "posterior apart": (1, "apart: ... chooses none of its cells"),
    "posterior chains --jobs 1": (1, "chains: cannot be written ... what was finished is kept"),
    # trials
    **{f"replay {path} c0 0": (1, f"{path}: {NO_RUN}") for path in (".", "none")},
    **{f"replay out {word}": (2, f"trial '{word}': {TRIAL}") for word in ("c0", "c0/", "c0/x", "c0/-1", "/1/2")},
    "replay out c0/1 1": (2, f"trial 'c0/1': {TRIAL}"),
    "replay out xyz 0": (2, "cell 'xyz': no such cell in tiny-"),
    "replay out '' 0": (2, "cell '': not one cell but 4: "),
    "replay out @ 5": (2, "trial 5: cell @ has trial 0 to 4"),
    # points
    "fit no.csv": (2, "no.csv: cannot be read: No such file or directory"),
    "fit .": (2, ".: cannot be read: "),
    "fit no.csv bad.csv": (2, "no.csv: cannot be read", 2),
    "fit cap.csv --columns x,y,w": (2, "cap.csv: no column 'w'"),
    **{f"fit cap.csv --noise {noise}": (2, f"--noise {noise}: ") for noise in ("0", "-0.1", "nan", "inf")},
    "fit cap.csv -e taubim": (2, "--estimator taubim: unknown; did you mean 'taubin'?"),
    "fit cap.csv -e zzz": (2, "--estimator zzz: unknown; known are mle, "),
    "fit cap.csv -e Als": (2, "--estimator Als: unknown; did you mean 'als'?"),
    "fit cap.csv -e ugdk --noise 1e-300 --plot out.png": (2, "--noise 1e-300: "),
    "fit cap.csv -e ugdk --noise 1e300": (2, "--noise 1e+300: "),
    "fit cap.csv -e ugdk": (2, "--estimator ugdk: needs the noise level"),
    "fit bad.csv --plot out.png": (2, "bad.csv: row 3, column 2: 'four' is not a number"),
    "fit timed.csv": (2, "timed.csv:  ... choose, as with --columns 1,2,3, or fit all with --dimension 4\n"),
    "fit cap.csv --radius 2 -e taubin": (2, "estimator = 'taubin': takes no known radius; mle, corrected, robust, "),
    # estimators of one's own
    **{
        line.replace("FILE", file): (2, f"{file}: {words}")
        for line in ("run coope.toml --plugin FILE", "check FILE", "fit cap.csv -e FILE:mine")
        for file, words in PLUGINS.items()
    },
    "certify -e corrected": (2, " ... known are mle, gdke, minimum_zone"),
    # names that the disk refuses
    **{f"{verb} {'a' * 300}": (1, "aaa") for verb in ("summary", "status")},
    **{f"{verb} {'a' * 300}": (2, "aaa") for verb in ("plan", "run")},
    f"summary {'a' * 300}/x": (1, "aaa"),
}


USAGE = {
    **dict.fromkeys(["rnu", "run", "report", "run tiny.toml --jobs 0", "plan -x a", "fit"], ""),
    **dict.fromkeys(["fit cap.csv --noise low", "fit cap.csv --nois 1", "certify --limit 0"], ""),
    **dict.fromkeys(["replay out c0 -1", "replay out c0 one", "replay out", "replay out c0 0 1"], ""),
    **dict.fromkeys([f"run need.toml --out new --budget {budget}" for budget in ("-1", "soon")], "--budget"),
    "run need.toml tiny.toml --budget 1": "--budget 1: tiny.toml has no [precision]",
    "run tiny.toml --backend slurm": "--backend is threads, loky or dask",
    "run tiny.toml --backend dask": "--scheduler",
    "run tiny.toml --scheduler tcp://127.0.0.1:9": "--scheduler goes with dask, and only with it",
    "run tiny.toml --task 10": "--task",
    "run tiny.toml --part 1/2 --summary": "--part 1/2: has no tables yet; leave --figures and --summary out",
    **{f"run tiny.toml --part {part}": f"--part {part}: give K/N, the K-th of N" for part in ("0/40", "41/40", "x")},
    "run tiny.toml --backend dask --scheduler tcp://127.0.0.1:9 --task 0": "--task",
    "summary out --where angle=91": "--where angle=91°: no cell has it; there are 90°",
    "summary out --where angle": "'angle': not CONDITION=VALUE, such as angle=45",
    "summary out --where angle=a": "--where angle=a: must be above 0 and at most 180 degrees",
    "summary out --where angle=-3": "--where angle=-3: must be above 0",
    "summary out --where angel=30": "--where angel: not a condition of the rows; did you mean 'angle'",
    "summary out --where colour=red": "--where colour: not a condition",
    "summary out --estimators kasa": "--estimators kasa: not in this run",
    "summary out --json --csv": "give one of --json, --csv, --ok and --measure",
    "summary out --measure fare": "--measure fare: not a measure of this run; did you mean 'far'?",
    "figures out fig_eficiency": "fig_eficiency: unknown; did you mean 'fig_efficiency'?",
    "figures fig_efficiency": "fig_efficiency: no run is given",
    "fit cap.csv --csv --json": "give --json or --csv, not both",
    f"fit cap.csv -e {','.join(map(str, range(3000)))}": "13,889 characters; give the name of one estimator, or all",
    "fit cap.csv cap.csv --plot out.png": "--plot: give one file",
    "worker": "Missing argument 'ADDRESS'",
    "plan-fit --noise 0.1 --radius 50": "a plan needs two of error, angle and points",
}

UNWRITTEN = {
    "fit cap.csv --plot cap.csv/out.png": "cap.csv/out.png",
    "fit cap.csv --plot out.xyz": "out.xyz",
    "fit cap.csv --plot .": ".",
    "replay out @ 0 --out points.txt": f"points.txt ... {KINDS}",
    "replay out @ 0 --out points": f"points ... {KINDS}",
    "replay out @ 0 --out file/p.csv": "file/p.csv: cannot be",
    "replay out @ 0 --out folder.csv": "folder.csv: cannot be",
}


@pytest.fixture
def cell(finished):
    """The name of a cell of the run, for which the tables have an @."""
    return str(Run.open(finished[0] / "out").table("errors")["cell"].iloc[0])


@pytest.mark.parametrize("line", REFUSED)
def test_refused(refused, folder, cell, line):
    """What is wrong is named in one line, or a line per fault, with the remedy; nothing is written."""
    code, words, *lines = REFUSED[line]
    refused(folder, code, words.replace("@", cell), *shlex.split(line.replace("@", cell)), lines=(lines or [1])[0])


@pytest.mark.parametrize("line", USAGE)
def test_wrong_usage(call_here, files_of, folder, line):
    """Wrong usage is code 2, the usage and what is wrong; nothing is written."""
    before = files_of(folder)
    code, said, complained = call_here(folder, *shlex.split(line))
    assert (code, said, files_of(folder)) == (2, "", before)
    assert complained.startswith("Usage: ")
    assert USAGE[line] in " ".join(complained.split())


@pytest.mark.parametrize("line", UNWRITTEN)
def test_a_file_that_cannot_be_written(refused, folder, cell, line):
    """A folder that is a file, a file that is a folder, another kind: code 1 and one line that names it."""
    refused(folder, 1, UNWRITTEN[line], *shlex.split(line.replace("@", cell)), silent=False)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no named pipes")
@pytest.mark.parametrize("line", ["fit cap.csv --plot PIPE.png", "report out --out PIPE", "regret out --csv PIPE.csv"])
def test_a_pipe_is_not_replaced(refused, folder, line):
    """Nor is a device: renaming would put a file in its place. Code 1 and one line; the pipe stays."""
    pipe = folder / next(word for word in line.split() if word.startswith("PIPE"))
    os.mkfifo(pipe)
    words = f"{pipe.name}: cannot be written: a device or a pipe has this name, and is not replaced; give another"
    refused(folder, 1, words, *line.split(), silent=False)
    assert pipe.is_fifo()


ENDLESS = ["plan ENDLESS", "check ENDLESS", "run ENDLESS", "estimators --plugin ENDLESS"]
ENDLESS += ["joints body.csv --unit mm --markerset ENDLESS", "skeleton body.csv --unit mm --calibration ENDLESS"]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no named pipes and no /dev")
@pytest.mark.parametrize("line", ENDLESS)
def test_what_may_never_end_is_not_opened(call_here, tmp_path, line):
    """A pipe nobody writes to would wait for ever, a device would fill the memory: one line for each."""
    names = [f"{name}:{axis}" for name in ("LASI", "RASI", "LPSI", "RPSI") for axis in "XYZ"]
    rows = [",".join(["Time", *names]), *(",".join(map(str, [i / 100, *range(12)])) for i in range(20))]
    (tmp_path / "body.csv").write_text("\n".join(rows))
    pipe, device = ("pipe.toml", "zero.toml") if "--markerset" in line else ("pipe.py", "zero.py")
    os.mkfifo(tmp_path / pipe)
    (tmp_path / device).symlink_to("/dev/zero")
    for endless in (pipe, device):
        code, said, complained = call_here(tmp_path, *line.replace("ENDLESS", endless).split())
        assert (code, said) in ((1, ""), (2, ""))
        assert f"{endless}: cannot be read: not a regular file" in complained
        assert len(complained.splitlines()) == 1 or "Usage: " in complained
    with pytest.raises(ConfigError, match="/dev/zero: cannot be read: not a regular file"):
        study.run("/dev/zero")


@pytest.mark.parametrize("threads", ["0", "-1", "two", ""])
def test_a_number_of_threads_that_is_none(call_here, tmp_path, monkeypatch, threads):
    """Numba would raise when it is imported."""
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    code, said, complained = call_here(tmp_path, "estimators")
    assert (code, said) == (2, "")
    assert complained == (
        f"NUMBA_NUM_THREADS = {threads!r}: must be a whole number above 0; unset it, or give --jobs\n"
    )


@pytest.mark.skipif(os.name == "nt", reason="on Windows links need a right of their own")
def test_a_link_becomes_a_file(well, folder):
    """A link to a file, or to nothing, is replaced by what is written; the file it led to keeps its bytes."""
    (folder / "link.png").symlink_to("cap.csv")
    (folder / "loose.png").symlink_to("nothing.png")
    for name in ("link.png", "loose.png"):
        well(folder, "fit", "cap.csv", "--plot", name)
        assert (folder / name).read_bytes()[1:4] == b"PNG"
        assert not (folder / name).is_symlink()
    assert (folder / "cap.csv").read_text() == POINTS


def test_a_closed_folder(call_here, well, folder, monkeypatch):
    """A folder that may not be entered is named, with what to do; so is a manifest that may not be read."""

    def closed(path):
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "is_file", closed)
        told = call_here(folder, "status", "closed")
    assert told == (1, "", "closed: cannot be read: Permission denied; make it readable, or give another folder\n")
    said = well(folder, "status", "odd")
    assert "odd/manifest.json: cannot be read: Is a directory; make it readable, or remove it" in said


def test_a_run_that_is_written_to(refused, call_here, folder):
    """`status` names the writer; a second writer is refused with code 1."""
    with writing(folder / "out"):
        assert "written by  process" in call_here(folder, "status", "out")[1]
        refused(folder, 1, "out: ... is writing to it", "run", "tiny.toml", "--out", "out")


@pytest.mark.parametrize("line", ["status newer", "run tiny.toml --out newer"])
def test_a_run_of_a_newer_version(refused, folder, line):
    """Code 1, one line, nothing touched."""
    store = Run.open(shutil.copytree(folder / "out", folder / "newer", dirs_exist_ok=True))
    store.save_manifest(store.manifest() | {"format": FORMAT + 1})
    refused(folder, 1, "newer ... made by a newer version of this program", *line.split())


@pytest.mark.parametrize("loop", ["while True: pass\n", LOOP], ids=["file", "fit"])
def test_a_loop_on_the_first_call_is_refused(refused, tmp_path, config, monkeypatch, loop):
    """A file, or an estimator, that does not return on sound points is refused in one line by every command."""
    monkeypatch.setattr(registry, "LIMIT", 0.5)
    (tmp_path / "loop.py").write_text(loop)
    (tmp_path / "tiny.toml").write_text(config)
    for words in (["check", "loop.py"], ["run", "tiny.toml", "--plugin", "loop.py"]):
        refused(tmp_path, 2, "loop.py: ... has not returned after 0.5 s", *words)


@pytest.fixture
def long(config, tmp_path):
    """A folder with a config of 200 units, of which the gate lets some pass."""
    text = config.replace("trials = 5", "trials = 200_000").replace("[5, 20]", "1000")
    (tmp_path / "long.toml").write_text(text.replace("[0.01, 0.1]", "[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]"))
    return tmp_path


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send to another process")
@pytest.mark.parametrize(
    ("backend", "jobs", "number"),
    [
        ("threads", 1, signal.SIGINT),
        pytest.param("threads", 2, signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param("loky", 2, signal.SIGINT, marks=pytest.mark.slow),
    ],
)
def test_interrupt(hold, long, backend, jobs, number):
    """Ctrl-C and SIGTERM end a run with code 130 and one line; its parts are whole, temporary files are gone."""
    out = long / "out"
    words = ["run", "long.toml", "--out", "out", "--jobs", jobs, "--backend", backend]
    process = hold(long, out / "parts", jobs, *words)
    # a terminal sends Ctrl-C to the workers, too, and they print nothing; a batch system may signal the parent alone
    os.killpg(process.pid, number) if backend == "loky" else process.send_signal(number)
    said, complained = process.communicate(timeout=600)
    assert (process.returncode, said) == (130, "")
    assert complained == "interrupted; run the same command again to resume\n"
    parts = Parts(out, "units")
    parts.load()
    assert parts.count == len(list((out / "parts").iterdir())) > 0
    assert sorted(path.name for path in out.iterdir()) == ["config.toml", "parts"]


@pytest.mark.parametrize(("verb", "words"), [("run", "; run the same command again to resume"), ("estimators", "")])
def test_a_command_that_starts_anew_does_not_say_that_it_resumes(monkeypatch, capsys, verb, words):
    """The line of an interruption promises to resume for commands that store what is finished, and for no others."""
    monkeypatch.setattr(sys, "argv", ["study", verb])

    def interrupted():
        raise SystemExit(130)

    with pytest.raises(SystemExit):
        cli.main(interrupted)
    assert capsys.readouterr().err == f"interrupted{words}\n"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no masks of signals")
def test_processes_that_just_start():
    """A process that starts while a task is sent has the signal blocked from the first; afterwards nothing has."""
    code = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    with interrupts_later():
        started = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert started.stdout == "True\n"
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def is_gone(process):
    """True when a process has ended, whether or not its new parent has taken note of it."""
    try:
        return process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def workers_of(process):
    """Worker processes of a process."""
    children = psutil.Process(process.pid).children()
    return [child for child in children if "popen_loky" in " ".join(child.cmdline())]


@pytest.mark.slow
def test_workers_end_with_a_killed_parent(hold, wait_for, long):
    """Worker processes at work notice that their parent is gone, and end."""
    words = ["run", "long.toml", "--out", "out", "--jobs", 2, "--backend", "loky"]
    process = hold(long, long / "out" / "parts", 2, *words)
    workers = workers_of(process)
    assert len(workers) == 2
    process.kill()
    wait_for(lambda: all(map(is_gone, workers)))


IDLE = """
import time
from study.simulation.runs import workers
workers._IDLE = 1e6  # in place of five minutes
with workers.Workers(backend="loky", jobs=2).open() as backend:
    backend.submit(time.sleep, 1000).result()
"""


def test_workers_without_a_task_end_with_a_killed_parent(wait_for):
    """A worker process that still waits for its first task ends, too, and not only when loky's patience ends."""
    with subprocess.Popen([sys.executable, "-c", IDLE]) as process:
        wait_for(lambda: len(workers_of(process)) == 2)
        workers = workers_of(process)
        process.kill()
    wait_for(lambda: all(map(is_gone, workers)))


WORDS = "Gaussian bound at the same σ"


@pytest.mark.parametrize("more", ["", 'law = ["normal", "student(3)"]\noutlier_share = [0, 0.2]\n'])
def test_every_text_names_the_law(well, config, tmp_path, more):
    """Summary, worst trials, replayed trials and the report say of which noise the bound is, where it is not plain."""
    (tmp_path / "laws.toml").write_text(config + more, encoding="utf-8")
    well(tmp_path, "run", "laws.toml", "--out", "laws")
    well(tmp_path, "report", "laws")
    worst = well(tmp_path, "worst", "laws")
    for text in (worst, well(tmp_path, "summary", "laws"), (tmp_path / "laws" / "report.html").read_text("utf-8")):
        assert (WORDS in text) == bool(more)
    names = [line.split()[0] for line in worst.splitlines() if "/" in line.split(" ")[0]]
    replayed = [well(tmp_path, "replay", "laws", name) for name in names]
    depart = ["law = student(3)" in text or "outliers = 0.2" in text for text in replayed]
    assert any(depart) == bool(more)
    assert [f"  {WORDS}: " in text for text in replayed] == depart
    assert ["  bound: " not in text for text in replayed] == depart


DISK_FULL = "standard output: cannot be written: No space left on device\n"


@pytest.mark.skipif(os.name == "nt", reason="Windows has neither /dev/full nor a shell")
@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("> /dev/full", 1, DISK_FULL),
        (">&-", 0, ""),  # there is nothing to say, and nobody to say it to
        ("| true; exit ${PIPESTATUS[0]}", 141, ""),  # as of a program that the signal ended, 128 + 13
    ],
)
def test_output_that_is_lost(command, tmp_path, line, code, words):
    """A full disk is code 1 and one line; a closed output and a reader that has gone are quiet."""
    if "full" in line and not os.path.exists("/dev/full"):
        pytest.skip("this system has no /dev/full")
    shell = ["bash", "-c", f"{shlex.join(command[0])} configs {line}"]
    done = subprocess.run(shell, cwd=tmp_path, env=command[1], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert (done.returncode, done.stderr.decode(errors="replace")) == (code, words)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no shell that closes an output")
@pytest.mark.parametrize("backend", ["threads", pytest.param("loky", marks=pytest.mark.slow)])
def test_a_run_that_nobody_hears(command, config, tmp_path, backend):
    """With standard error closed a run is computed as with it."""
    (tmp_path / "tiny.toml").write_text(config)
    line = shlex.join([*command[0], "run", "tiny.toml", "--out", "out", "--backend", backend])
    done = subprocess.run(["bash", "-c", f"{line} 2>&-"], cwd=tmp_path, env=command[1], stdout=subprocess.PIPE)
    assert (done.returncode, done.stdout) == (0, b"out\n")
    assert len(Run.open(tmp_path / "out").table("errors")) == 5 * 2 * 2 * 2  # trials, samples, noises, estimators


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such names")
def test_a_folder_whose_name_is_not_utf_8(refused, config, tmp_path):
    """Code 1 and one line, whether it is to be made or read."""
    (tmp_path / "tiny.toml").write_text(config)
    name = os.fsdecode(b"o\xff")
    try:
        (tmp_path / name).mkdir()
    except OSError:
        pytest.skip("this disk has no such names")
    for words in (["run", "tiny.toml", "--out", name], ["summary", name], ["verify", name]):
        assert "not UTF-8" in refused(tmp_path, 1, "", *words)
    assert sys.getfilesystemencoding() == "utf-8"
