"""Tables in Markdown, in files that the book's pages include."""

from collections.abc import Sequence

from d2d.study.results import results_path


def markdown(header: Sequence[str], lines: Sequence[Sequence[str]], left: int = 1) -> str:
    """A Markdown table with the first ``left`` columns aligned left and the others right."""
    widths = [max(map(len, column)) for column in zip(header, *lines, strict=True)]

    def line(cells: Sequence[str]) -> str:
        padded = (
            cell.ljust(width) if i < left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(cells, widths, strict=True))
        )
        return f"| {' | '.join(padded)} |"

    rule = ["-" * width if i < left else "-" * (width - 1) + ":" for i, width in enumerate(widths)]
    return "\n".join([line(header), line(rule), *map(line, lines)])


def write_page(name: str, command: str, parts: Sequence[str]) -> None:
    """Write a page's include, headed by the command that renews it."""
    text = "\n\n".join([f"<!-- Written by `python -m {command}`. -->", *parts])
    results_path(name).write_text(f"{text}\n", encoding="utf-8")
    print(f"{name}\n\n{text}\n", flush=True)
