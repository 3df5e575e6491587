"""Hook of mkdocs: takes pages from all over the repository under their own paths, so that links hold."""

from __future__ import annotations

from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[2]
PAGES = (
    "*.md",
    "docs/*.md",
    "docs/images/*",
    "docs/make/site.css",
    "examples/README.md",
    "examples/*/*",
    "examples/recordings/*/README.md",
)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """The files of the theme, and the pages with their pictures and examples under their own paths."""
    own = [
        File.generated(config, path.relative_to(ROOT).as_posix(), abs_src_path=str(path))
        for pattern in PAGES
        for path in sorted(ROOT.glob(pattern))
        if path.is_file()
    ]
    return Files([*(file for file in files if file.src_dir != config.docs_dir), *own])
