"""The table of ratios on the page."""

import pytest

from study.analysis.claims import judge_all
from study.report.blocks import Table
from study.report.material import Material
from study.report.page import render
from study.report.speed import COLUMNS, read_bench, speed_section
from study.runs.storage.atomic_write import RunError

ROWS = """group,what,cost,measured,ratio,aim,machine
"loop, per sample",filling memory,36.2,ns,1,,Some CPU
"loop, per sample",ours,33.7,ns,0.931,≤ 1,Some CPU
memory,one worker,512,MB,,< 1024,Some CPU
"""


@pytest.fixture
def stored(tmp_path):
    """A stored table."""
    (tmp_path / "bench.csv").write_text(ROWS, encoding="utf-8")
    return tmp_path / "bench.csv"


def test_a_table_for_each_group(stored):
    """In the order of the file, cells as they are stored, the machine named."""
    (section,) = speed_section(Material([], None, {}, {}, None, [], read_bench(stored)))
    text, *tables = section.content
    assert "Some CPU" in text.content
    assert [table.caption for table in tables] == ["loop, per sample", "memory"]
    assert all(isinstance(table, Table) for table in tables)
    assert [list(row.cells) for row in tables[0].rows] == [
        ["filling memory", "36.2\u00a0ns", "1", ""],
        ["ours", "33.7\u00a0ns", "0.931", "≤ 1"],
    ]


def test_costs_in_units_that_suit_them(tmp_path):
    """Nanoseconds become seconds where they are so many; other units stay."""
    lines = [
        ROWS.splitlines()[0],
        *(f"times,{n},{n},ns,{n},,Some CPU" for n in ("0.327", "5931", "5.584e+07", "5.2e+10")),
    ]
    (tmp_path / "bench.csv").write_text("\n".join([*lines, "times,memory,383.2,MB,,,Some CPU", ""]), encoding="utf-8")
    (section,) = speed_section(Material([], None, {}, {}, None, [], read_bench(tmp_path / "bench.csv")))
    rows = [[str(cell).replace("\u00a0", " ") for cell in row.cells] for row in section.content[1].rows]
    assert [row[1] for row in rows] == ["0.327 ns", "5.93 µs", "55.8 ms", "52.0 s", "383.2 MB"]
    assert [row[2] for row in rows] == ["0.327", "5931", "5.584 × 10⁷", "5.2 × 10¹⁰", ""]


def test_no_table_no_section():
    """A page about runs alone has none."""
    assert list(speed_section(Material([], None, {}, {}, None, []))) == []


@pytest.mark.parametrize("content", [None, "", "a,b\n1,2\n", ",".join(COLUMNS) + "\n", "\xff\xfe"])
def test_other_files(tmp_path, content):
    """A file that is none, or not this table, is named, with what writes one."""
    path = tmp_path / "other.csv"
    if content is not None:
        path.write_bytes(content.encode("latin-1"))
    with pytest.raises(RunError, match=r"other\.csv: .*make bench writes it"):
        read_bench(path)


def test_a_study_that_kept_its_summary_alone(make_run):
    """Has its page, too: trials and samples are counted from the summary, and what is not known is said."""
    run = make_run(
        """name = "alone"
seed = 3
estimators = ["gdke", "ugdk"]
keep = "summary"
[design]
kind = "grid"
trials = 30
samples = [10, 20]
noise = 0.05
angle = [60, 90]
"""
    )
    page = render([run], judge_all([run], None))
    assert "which trials were worst is not known" in page
    assert "SHA-256 of summary.parquet" in page
    record = Material.of([run], judge_all([run], None)).records[0]
    assert (record.trials, record.samples) == (120, 2 * 30 * (10 + 20))
