"""Each check of a page finds what it is for, and accepts a page that has nothing wrong."""

from pathlib import Path

import pytest
from selenium import webdriver

from tests.book import browser
from tests.book.checks import CHECKS, MAX_BYTES, MAX_SCREENS, MAX_SHARED_BYTES, pages

PAGE = """<!doctype html><html data-theme="light"><head><meta charset="utf-8"><title>Page</title>
<link rel="icon" href="data:,"><style>
html {{ background: white; color: #222; }} a {{ color: inherit; }}
html[data-theme="dark"] {{ background: #111; color: #ddd; }}
</style></head><body><article id="main"><p>Text, and a <code>\\(formula\\)</code> as code.</p>
<div style="overflow-x: auto"><pre style="width: 2000px">wide, but in a box of its own</pre></div>
<a href="#main">here</a> <a href="other.html#place">there</a> <a href="https://doi.org/10.1">far</a>
<a href="#fig-b">Figure 2</a><figure id="fig-b">{picture}<figcaption>dark</figcaption></figure>
<pre>short</pre>{fault}</article></body></html>"""


def svg(color: str) -> str:
    """A square of one colour with a smaller black one in it: no picture if that is black too."""
    shapes = f"<rect width='9' height='9' fill='{color}'/><rect x='3' width='3' height='3'/>"
    start = "<svg xmlns='http://www.w3.org/2000/svg' width='9' height='9'>"
    return f"data:image/svg+xml,{start}{shapes}</svg>"


PICTURE = f'<img alt="A square." src="{svg("white")}">'
WIDE_TABLE = "<table><tr>{}</tr></table>".format(7 * "<td style='min-width: 90px'>x</td>")
WIDE_IMG = "<img style='width: 500px'"
MATH = f"<div class='math' style='overflow: {{}}; width: 90px'><b>{50 * 'x'}</b></div>"
TEX_ERROR = "<mjx-container><mjx-merror>x</mjx-merror></mjx-container>"
FORMULA = "<mjx-container style='display: inline-block; width: 3em'>x</mjx-container>"
FAULTS: list[tuple[str, str]] = [
    ("complaints", "<script>console.error('no')</script>"),
    ("complaints", "<script>undefined.property</script>"),
    ("complaints", "<script src='missing.js'></script>"),
    ("complaints", "<script src='https://cdn.jsdelivr.net/a.js'></script>"),
    ("too_heavy", f"<!--{'x' * MAX_BYTES}-->"),
    ("formulas", r"<p>where \(x\) is</p>"),
    ("formulas", r"<p>where $$x + y$$ is</p>"),
    ("formulas", "<p>where $x_1$ is</p>"),
    ("formulas", r"<p>where \alpha is</p>"),
    ("formulas", r"<span class='math'>x</span>"),
    (
        "formulas",
        f"<span class='math'>{TEX_ERROR}</span>",
    ),
    ("pictures", f'<img src="{svg("white")}">'),
    ("pictures", f'<img alt="A square." src="{svg("black")}">'),
    ("pictures", '<img alt="A square." src="missing.png">'),
    ("references", "<a href='missing.html'>there</a>"),
    ("references", "<a href='other.html#nowhere'>there</a>"),
    ("references", "<a href='#nowhere'>here</a>"),
    ("references", "<a href='https://doi/10.1'>far</a>"),
    ("references", "<a href='file:///home'>far</a>"),
    ("references", "<span class='xref myst'>chapter nine</span>"),
    ("overflows", "<p style='width: 500px'>wide on a phone</p>"),
    ("overflows", "<div style='overflow: hidden'><p style='width: 1500px'>cut off</p></div>"),
    ("overflows", "<div style='overflow: auto; width: 450px'><p style='width: 600px'>x</p></div>"),
    ("shrunken", f'<img alt="A square." style="width: 5px" src="{svg("white")}">'),
    ("pushed", f"<figure style='overflow: auto'>{PICTURE.replace('<img', WIDE_IMG)}</figure>"),
    ("pushed", MATH.format("auto")),
    ("crowded", f"<div class='measured-scroll' style='overflow: auto'>{WIDE_TABLE}</div>"),
    ("tiny", "<svg width='90' viewBox='0 0 900 90'><text y='50' font-size='16'>word</text></svg>"),
    ("orphans", f"<p style='width: 3em'><span class='math'>{FORMULA}</span>, then</p>"),
    ("faint", "<p style='color: #888; background: white'>grey on white</p>"),
    ("faint", "<p style='color: #222'>black on black in the dark theme</p>"),
    ("faint", "<p style='color: rgb(0 0 0 / 40%); background: white'>see-through</p>"),
    ("shared", "<script src='_static/large.js'></script>"),
    ("cut", "<pre style='overflow: auto'>{}</pre>".format(200 * "code ")),
    ("cut", MATH.format("hidden")),
    ("pale", "<figure><figcaption style='font-weight: 300'>thin</figcaption></figure>"),
    ("pale", "<figure><figcaption style='color: #999'>grey</figcaption></figure>"),
    ("unmarked", "<button style='outline: none'>no ring</button>"),
    ("unmarked", "<mjx-container tabindex='0'>x</mjx-container>"),
    ("private", "<code>path=PosixPath('HOME/results.json')</code>"),
    ("too_long", f"<div style='height: {900 * MAX_SCREENS}px'></div>"),
    ("uncited", f"<div id='fig-a'>{PICTURE}</div>"),
    ("uncited", f"<div id='fig-a'>{PICTURE}</div><a href='#fig-a'>Figure 1</a>"),
    ("uncited", f"<div id='fig-a'>{PICTURE}<a href='#fig-a'>#</a></div>"),
]


def look(fault: str, driver: webdriver.Chrome, folder: Path) -> browser.Visit:
    fault = fault.replace("HOME", str(folder.resolve().parents[1]))
    (folder / "page.html").write_text(PAGE.format(picture=PICTURE, fault=fault), encoding="utf-8")
    (folder / "other.html").write_text("<p id='place'>There.</p>", encoding="utf-8")
    (folder / "_static").mkdir(exist_ok=True)
    (folder / "_static" / "large.js").write_text(f"//{'x' * MAX_SHARED_BYTES}", encoding="utf-8")
    with browser.serve(folder) as address:
        return browser.visit(driver, f"{address}page.html")


def test_a_sound_page_is_accepted(driver: webdriver.Chrome, tmp_path: Path):
    visit = look("", driver, tmp_path)
    assert {name: check(visit, tmp_path) for name, check in CHECKS.items()} == {
        name: [] for name in CHECKS
    }


@pytest.mark.parametrize(
    ("name", "fault"), FAULTS, ids=[f"{name}-{n}" for n, (name, _) in enumerate(FAULTS)]
)
def test_a_fault_is_found(name: str, fault: str, driver: webdriver.Chrome, tmp_path: Path):
    assert CHECKS[name](look(fault, driver, tmp_path), tmp_path) != []


def test_every_check_is_shown_to_find_something():
    assert {name for name, _ in FAULTS} == set(CHECKS)


def test_pages_come_in_the_order_of_reading():
    toc = {
        "root": "intro",
        "parts": [
            {"chapters": [{"file": "a", "sections": [{"file": "b"}]}]},
            {"chapters": [{"file": "c"}]},
        ],
    }
    assert list(pages(toc)) == ["intro", "a", "b", "c"]
