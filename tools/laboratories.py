"""A Sphinx extension that loads the laboratories' scripts on those pages that have one.

Jupyter Book by itself would load every script on every page.  The example log of the command line
is also written as a script: a book that is opened from a folder can load no CSV file.
"""

from __future__ import annotations

import io
import json
import re
import tempfile
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.config import Config

from d2d.radar import cli

FOLDER = "labs/"
LABORATORY = re.compile(r'<div class="lab"[^>]* data-lab="([a-z]+)"')
SHARED = ("engine", "kit")
NEEDED = {"log": ("tracker",), "replay": ("replay_data",)}  # by these, before their own script


def leave_out(app: Sphinx, config: Config) -> None:
    """Take the laboratories' files, and the theme's icons, out of those that every page loads."""
    for name in ("html_js_files", "html_css_files"):
        files = getattr(config, name)
        kept = [file for file in files if not str(file).startswith((FOLDER, "vendor/"))]
        setattr(config, name, kept)


def load(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """Load what the laboratories of a page need."""
    names = sorted(set(LABORATORY.findall(context.get("body", ""))))
    if not names:
        return
    app.add_css_file(f"{FOLDER}labs.css")
    needed = dict.fromkeys(script for name in names for script in NEEDED.get(name, ()))
    for name in (*SHARED, *needed, *names):
        app.add_js_file(f"{FOLDER}{name}.js", loading_method="defer")


def example_script() -> str:
    """The log of ``python -m d2d.radar example`` as a script."""
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
        log = Path(folder) / "log.csv"
        cli.main(["example", str(log)])
        return f"globalThis.exampleLog = {json.dumps(log.read_text(encoding='utf-8'))};\n"


def write_example(app: Sphinx, error: Exception | None) -> None:
    """Write the example beside the laboratories' scripts."""
    folder = Path(app.outdir) / "_static" / FOLDER
    if error is None and folder.is_dir():
        (folder / "example.js").write_text(example_script(), encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("config-inited", leave_out)
    app.connect("html-page-context", load)
    app.connect("build-finished", write_example)
    return {"parallel_read_safe": True}
