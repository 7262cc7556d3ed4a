"""The rows of numbers in a text file: cells, decimal commas, missing samples, and frames that are left out."""

import csv
import io
from dataclasses import dataclass

import numpy as np
import pandas as pd

from study.mocap.io.recording import RecordingError
from study.sphere.types import Floats

_MISSING = ["nan", "NaN", "NAN", "na", "NA", "N/A", "null", "NULL", "Null", "none", "None", "-"]
MOST_MISSING = 0.1
"""Share of a file's frames that may be missing; with more the file is a part of another one."""


@dataclass(frozen=True)
class Rows:
    """The rows of numbers in a file."""

    lines: list[str]
    first: int
    """Number of its first line in the file, from 1."""
    delimiter: str

    def numbers(self, columns: int) -> Floats:
        """The cells of the rows (rows, columns); empty ones are NaN."""
        if not self.lines:
            return np.empty((0, columns))
        text = "\n".join(self.lines).replace('"', "")
        cells = np.array([line.count(self.delimiter) + 1 for line in self.lines], dtype=int)
        if (cells < columns).any():
            row = int((cells < columns).argmax())
            raise RecordingError(
                f"line {self.first + row} has {cells[row]} cells; {columns} are needed; the line may be cut short"
            )
        decimal = "," if self.delimiter != "," and "," in text and "." not in text else "."
        table = pd.read_csv(
            io.StringIO(text),
            sep=self.delimiter,
            header=None,
            names=range(int(cells.max())),
            index_col=False,
            decimal=decimal,
            na_values=_MISSING,
            skipinitialspace=True,
            skip_blank_lines=False,
            quoting=csv.QUOTE_NONE,
            low_memory=False,
        )
        numbers = np.empty(table.shape)
        for column in range(table.shape[1]):
            values = table[column]
            numbers[:, column] = parsed = pd.to_numeric(values, errors="coerce").to_numpy(dtype=np.float64)
            wrong = np.isnan(parsed) & values.notna().to_numpy()
            if column >= columns:  # a line may end in delimiters, but not in further numbers
                wrong = values.notna().to_numpy()
            if wrong.any():
                row = int(wrong.argmax())
                words = "is not a number" if column < columns else "has no header"
                place = f"line {self.first + row}, column {column + 1}"
                raise RecordingError(f"{place}: {str(values.iloc[row])[:40]!r} {words}")
        return numbers[:, :columns]


def with_all_frames(counter: Floats, numbers: Floats, first: int) -> tuple[Floats, tuple[str, ...]]:
    """Put in rows without samples for the frames that a table leaves out, so that the times of all others are right.

    Args:
        counter: number of the frame in each row (rows,).
        numbers: the table (rows, columns).
        first: number of the first row's line in the file, from 1.

    Returns:
        The table with a row for every frame, and a note if any was put in.

    Raises:
        RecordingError: if the frames do not follow each other, or more than `MOST_MISSING` of them are left out.
    """
    steps = np.diff(counter)
    if (steps == 1).all():
        return numbers, ()
    whole = int(counter[-1] - counter[0]) + 1 if np.isfinite(counter).all() else 0
    lacking = whole - len(counter)
    if (steps < 1).any() or (steps % 1 != 0).any() or lacking > MOST_MISSING * whole:
        row = int((steps != 1).argmax())
        raise RecordingError(f"line {first + row + 1}: frame {counter[row + 1]:g} follows frame {counter[row]:g}")
    complete = np.full((whole, numbers.shape[1]), np.nan)
    complete[(counter - counter[0]).astype(int)] = numbers
    place = int((steps > 1).argmax())
    words = (
        f"{lacking} of {whole} frames are not in it, the first after frame {counter[place]:g}: they count as missing"
    )
    return complete, (words,)


def missing_frames_note(found: int, promised: int) -> tuple[str, ...]:
    """The note on a file that holds fewer frames than its header promises; none if it holds as many, or more.

    Raises:
        RecordingError: if more than `MOST_MISSING` of the frames are missing.
    """
    if found >= promised:
        return ()
    if found < (1 - MOST_MISSING) * promised:
        raise RecordingError(f"the file is cut short: {found} of {promised} frames are there; get a whole copy of it")
    return (f"its header promises {promised} frames, but {found} are there: the end may be cut off",)


def as_points(numbers: Floats) -> Floats:
    """Rows of coordinates (frames, 3 markers) as (markers, 3, frames)."""
    points: Floats = numbers.T.reshape(numbers.shape[1] // 3, 3, len(numbers))
    return points


def until_blank(lines: list[str], start: int) -> list[str]:
    """Lines from a place up to the first empty one."""
    end = next((i for i in range(start, len(lines)) if not lines[i].strip(" ,;\t")), len(lines))
    return lines[start:end]


def find_delimiter(line: str) -> str:
    """The comma, semicolon or tab, whichever is most frequent in a line."""
    return max(",;\t", key=line.count)


def cells_of(line: str, delimiter: str) -> list[str]:
    """The cells of a line of a header, without spaces and quotes around them."""
    return [cell.strip().strip("\"'").strip() for cell in line.split(delimiter)]
