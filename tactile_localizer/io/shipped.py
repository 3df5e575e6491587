"""Finding the configuration files that come with the package, wherever it is installed."""

from __future__ import annotations

from pathlib import Path


def shipped(*parts: str) -> Path | None:
    """Path of a shipped file or folder, such as ``shipped("config", "scenes", "linen.yaml")``.

    Returns
    -------
    Path or None
        ``None`` when this installation does not have it.
    """
    for parent in Path(__file__).resolve().parents:
        share = parent / "share" / "tactile_localizer"
        roots = (parent, share) if (parent / "package.xml").exists() else (share,)
        for root in roots:
            path = root.joinpath(*parts)
            if path.exists():
                return path
    return None


def given_or_shipped(path: str | Path, *folder: str) -> Path:
    """``path`` where it exists, else the shipped file of that name in ``folder``, else ``path`` again."""
    path = Path(path)
    if not path.exists() and path.parent == Path("."):
        return shipped(*folder, path.name) or path
    return path
