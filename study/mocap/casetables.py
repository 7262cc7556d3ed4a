"""Case studies, read back for the paper's claim on recordings: how each joint's centre scatters over random frames."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from pandas.api import types

from study.mocap.casestudy import best
from study.mocap.recording import RecordingError
from study.runs import tables

_SCATTER = "case-study-scatter.parquet"
_COLUMNS = {
    "joint": types.is_string_dtype,
    "way": types.is_string_dtype,
    "dropped": types.is_bool_dtype,
    "samples": types.is_integer_dtype,
    "median": types.is_float_dtype,
    "error": types.is_float_dtype,
}
_ROW = ["joint", "samples"]


def read_case_studies(folders: Sequence[Path]) -> pd.DataFrame:
    """Read how joints scatter over random subsets of the frames of recordings.

    Frames that follow each other are left out: the paper took random ones.

    Args:
        folders: that `study case-study` wrote to, at least one, each of another recording.

    Returns:
        A row per recording, joint and N: ``recording``, its place among the folders; ``joint``; ``samples``, N; and in
        metres ``spread``, the median distance from the whole recording's answer, across the axis of a hinge where the
        case study dropped that, failures farther than any; ``with_axes``, the same with every axis kept, as the paper
        has it; ``error``, the spread and the whole answer's own standard error together.

    Raises:
        RecordingError: if a folder has no case study, one that cannot be read, or one that another has, too.
    """
    found = [_read(folder) for folder in folders]
    for place, table in enumerate(found):
        for before in range(place):
            if table.equals(found[before]):
                same = f"{folders[before]} and {folders[place]}"
                raise RecordingError(f"{same}: the same case study; give it once, for it would count twice")
    return pd.concat([table.assign(recording=place) for place, table in enumerate(found)], ignore_index=True)


def _read(folder: Path) -> pd.DataFrame:
    path, remedy = folder / _SCATTER, f"`study case-study FILE --out {folder}` makes one"
    try:
        scatter: pd.DataFrame = tables.read(path)
    except (FileNotFoundError, NotADirectoryError):
        raise RecordingError(f"{folder}: not the folder of a case study, without {_SCATTER}; {remedy}") from None
    except (OSError, ValueError, KeyError, TypeError):  # the last two from words about the columns that are garbled
        raise RecordingError(f"{path}: cannot be read: damaged, or no parquet; {remedy}") from None
    odd = [name for name, fits in _COLUMNS.items() if name not in scatter or not fits(scatter[name])]
    if odd:
        raise RecordingError(f"{path}: not of this version: {', '.join(odd)} missing or of another type; {remedy}")
    random = scatter[scatter["way"] == "random"]
    if random.empty or random.duplicated([*_ROW, "dropped"]).any():
        raise RecordingError(f"{path}: not one row per joint and number of random frames; {remedy}")
    across, kept = best(random).set_index(_ROW), random[~random["dropped"]].set_index(_ROW)
    columns = {"spread": across["median"], "with_axes": kept["median"], "error": across["error"]}
    return pd.DataFrame(columns).reset_index()
