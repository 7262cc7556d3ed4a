"""Read stored case studies, for the paper's claim on recordings: the scatter of joint centres from random frames."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from pandas.api import types

from study.mocap.case_study.scatter_summary import without_hinge_axes
from study.mocap.io.origin import ORIGIN
from study.mocap.io.recording import RecordingError
from study.runs.storage import schemas

_SCATTER = "case-study-scatter.parquet"
_COLUMNS = {
    **dict.fromkeys(ORIGIN, types.is_string_dtype),
    "joint": types.is_string_dtype,
    "way": types.is_string_dtype,
    "dropped": types.is_bool_dtype,
    "samples": types.is_integer_dtype,
    "median": types.is_float_dtype,
    "error": types.is_float_dtype,
}
_ROW = ["joint", "samples"]


def read_case_studies(folders: Sequence[Path]) -> pd.DataFrame:
    """Read the scatter of joint centres over random subsets of the frames of recordings.

    Consecutive frames are left out, as the paper took random ones.

    Args:
        folders: of `study case-study`, at least one; several may be of one recording, with different seeds.

    Returns:
        A row per case study, joint and N: ``recording``, the digest of the recording's file; ``joint``; ``samples``, N;
        and in metres ``spread``, the median distance from the whole recording's centre, without the axis of a hinge if
        the case study dropped it, where a failed fit counts as farther than any other; ``with_axes``, the same with
        every axis kept, as in the paper; ``error``, the spread and the standard error of the whole recording's centre
        together; ``doubted``, whether the joint is in doubt, as all are in a table that does not say.

    Raises:
        RecordingError: if a folder has no case study, one that cannot be read or does not name its recording, or the
            same one as another folder.
    """
    found = [_read(folder) for folder in folders]
    for place, table in enumerate(found):
        for before in range(place):
            if table.equals(found[before]):
                same = f"{folders[before]} and {folders[place]}"
                raise RecordingError(f"{same}: the same case study; give it once, else its subsets count twice")
    return pd.concat(found, ignore_index=True)


def _read(folder: Path) -> pd.DataFrame:
    """Read one case study; see `read_case_studies`."""
    path, command = folder / _SCATTER, f"`study case-study FILE --out {folder}`"
    remedy, again = f"{command} writes one", f"run the case study again: {command}"
    try:
        scatter: pd.DataFrame = schemas.read(path)
    except (FileNotFoundError, NotADirectoryError):
        raise RecordingError(f"{folder}: not the folder of a case study, as it has no {_SCATTER}; {remedy}") from None
    except (OSError, ValueError, KeyError, TypeError):  # the last two if the text about the columns is garbled
        raise RecordingError(f"{path}: cannot be read: it is damaged, or not parquet; {remedy}") from None
    if not set(ORIGIN) <= set(scatter):
        absent = f"{path.name} has no columns {' and '.join(ORIGIN)}"
        raise RecordingError(f"{folder}: a case study that does not name its recording: {absent}; {again}")
    odd = [name for name, fits in _COLUMNS.items() if name not in scatter or not fits(scatter[name])]
    if odd:
        raise RecordingError(
            f"{path}: written by another version: {', '.join(odd)} missing or of another type; {remedy}"
        )
    if scatter["digest"].nunique() != 1:
        raise RecordingError(f"{path}: of {scatter['digest'].nunique()} recordings, not of one; {again}")
    random = scatter[scatter["way"] == "random"]
    if random.empty or random.duplicated([*_ROW, "dropped"]).any():
        raise RecordingError(f"{path}: not one row per joint and number of random frames; {remedy}")
    across, kept = without_hinge_axes(random).set_index(_ROW), random[~random["dropped"]].set_index(_ROW)
    columns = {"spread": across["median"], "with_axes": kept["median"], "error": across["error"]}
    # a table of before doubts were stored rests on errors without skin
    columns["doubted"] = across["doubted"].astype(bool) if "doubted" in across else pd.Series(True, across.index)
    return pd.DataFrame(columns).reset_index().assign(recording=scatter["digest"].iloc[0])
