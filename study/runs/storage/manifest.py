"""The manifest of a run: what was computed, by what, and the digests of its tables and of the manifest itself.

A manifest that does not have its own digest, or whose fields are not as declared, is damaged: nothing in it is used.
"""

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from study.runs.storage import digests
from study.runs.storage.atomic_write import RunError, write
from study.runs.storage.parts import FORMAT

Manifest = dict[str, Any]
"""A manifest as JSON has it."""
NAME = "manifest.json"
DIGEST = "digest"
_ALWAYS: dict[str, type | tuple[type, ...]] = {"format": int, "run": str, "tables": dict}
_FINISHED: dict[str, type | tuple[type, ...]] = {
    **dict.fromkeys(("cells", "fits", "failures", "lost", "jobs"), int),
    **dict.fromkeys(("seconds", "seconds_computing"), (int, float)),
    **dict.fromkeys(("started", "backend"), str),
    **dict.fromkeys(("config", "estimators", "software", "machine"), dict),
    "also_computed_by": list,
}
"""Fields of a run that is finished; chains may be stored before."""
_PERHAPS: dict[str, type | tuple[type, ...]] = {
    "posterior": dict,
    "precision": dict,
    "stopped_after": (int, float),
    "own_estimators": list,
}


class ManifestMissingError(RunError):
    """A run without a manifest, because it is not finished."""


class ManifestDamagedError(RunError):
    """A manifest that was changed since it was written, or is not as this program writes it."""


class ManifestNewerError(RunError):
    """A manifest that a newer version of this program wrote."""


def save(folder: Path, content: Manifest) -> None:
    """Write the manifest of a run, with its digest."""
    rest = {key: value for key, value in content.items() if key != DIGEST}
    whole = rest | {DIGEST: digests.of_json(rest)}
    write(folder / NAME, (json.dumps(whole, indent=2, ensure_ascii=False) + "\n").encode())


def read(folder: Path, keep: str, own: Collection[str] = ()) -> Manifest:
    """Read the manifest of a run.

    Args:
        folder: the run's.
        keep: name of the table whose presence means that the run has been finished.
        own: files or packages whose estimators the run has, for messages.

    Raises:
        ManifestMissingError: if it is not there.
        ManifestDamagedError: if its digest is not that of its content, or a field is missing or of another type.
        ManifestNewerError: if a newer version of this program wrote it.
    """
    path = folder / NAME
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ManifestMissingError(f"{path}: missing; finish the run with {rerun(folder, own)}") from None
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror or error}; make it readable, or remove it") from None
    except (ValueError, RecursionError):
        found = None
    fault = "not JSON, or no object" if not isinstance(found, dict) else _digest_fault(found)
    if not fault and isinstance(found["format"], int) and found["format"] > FORMAT:
        made = found["software"].get("study", "unknown") if isinstance(found.get("software"), dict) else "unknown"
        words = f"made by a newer version of this program ({made})"
        raise ManifestNewerError(f"{folder}: {words}; update it, or choose another folder with --out")
    fault = fault or _field_fault(found, keep)
    if fault:
        raise ManifestDamagedError(f"{path}: damaged: {fault}; {rerun(folder, own)} makes it again")
    checked: Manifest = found
    return checked


def rerun(folder: Path, own: Collection[str]) -> str:
    """The command that makes a run again, or resumes it.

    Args:
        folder: the run's.
        own: files or packages whose estimators it has; packages are found without an option.
    """
    return f"`{' '.join(['study run', str(folder / 'config.toml'), '--out', str(folder), *plugins(own)])}`"


def plugins(own: Collection[str]) -> list[str]:
    """The options that give the files among the origins of estimators."""
    return [word for name in own if name.endswith(".py") for word in ("--plugin", name)]


def own_estimators(folder: Path) -> list[str]:
    """Files or packages whose estimators a run has, by its manifest, whatever else is wrong with that.

    Returns:
        Their names; none if all estimators were shipped, or the manifest does not say.
    """
    try:
        found = json.loads((folder / NAME).read_text(encoding="utf-8"))
        return [str(entry["from"]) for entry in found["own_estimators"]]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return []


def _digest_fault(found: Mapping[str, Any]) -> str | None:
    """Compare a manifest with its own digest."""
    if DIGEST not in found:
        return f"no field '{DIGEST}', so that nothing vouches for the tables"
    rest = {key: value for key, value in found.items() if key != DIGEST}
    if found[DIGEST] != digests.of_json(rest):
        return f"its {DIGEST} is not that of its content"
    return None if "format" in found else "no field 'format'"


def _field_fault(found: Mapping[str, Any], keep: str) -> str | None:
    """Find a field that is missing or of another type."""
    needed = _ALWAYS | (_FINISHED if isinstance(found.get("tables"), dict) and keep in found["tables"] else {})
    for name, kind in (needed | _PERHAPS).items():
        if name not in found:
            if name in needed:
                return f"no field '{name}'"
        elif not isinstance(found[name], kind) or isinstance(found[name], bool):
            return f"{name} = {json.dumps(found[name])[:40]} is not as this program writes it"
    words = [*found["tables"].values(), *found.get("estimators", {})]
    versions, numbers = found.get("estimators", {}).values(), found.get("precision", {}).values()
    made_by = [found.get("software", {}), *found.get("also_computed_by", [])]
    entries = [*made_by, *found.get("own_estimators", [])]
    if not all(isinstance(entry, dict) for entry in entries) or not all(
        isinstance(made.get(name), str | None) for made in made_by for name in ("study", "commit")
    ):
        return "software or own_estimators are not as this program writes them"
    shipped = "own_estimators" not in found  # the version of an own estimator is a digest of its code
    fine = all(isinstance(word, str) for word in words) and all(isinstance(number, int) for number in numbers)
    if not fine or not all(isinstance(version, int if shipped else int | str) for version in versions):
        return "tables or estimators are not as this program writes them"
    return None
