"""Hooks of mkdocs: pages from all over the repository keep their paths; links to messages show them."""

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

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


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """The text of a page, followed by the definitions of the messages and services that it links to."""
    links = re.findall(r"\]\((\.\./(?:msg|srv)/(\w+)\.\w+)\)", markdown)
    for path, name in links:
        markdown = markdown.replace(f"]({path})", f"](#{name.lower()})")
        markdown += f"\n### {name}\n\n```\n{(ROOT / 'docs' / path).read_text()}```\n"
    return markdown


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Code within text is broken after a slash or an underscore, and not within an option."""

    def breakable(code: re.Match[str]) -> str:
        text = re.sub(r"(?<=\w[/_])(?=\w)", "<wbr>", code[0])
        return re.sub(r"--[a-z][a-z-]*", r"<span>\g<0></span>", text)

    return re.sub(r"(?<!<pre>)<code>[^<]*", breakable, html)
