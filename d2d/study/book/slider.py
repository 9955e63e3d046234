"""Animations that need no server: all frames in one piece of HTML, with a slider."""

from collections.abc import Sequence
from html import escape

_SCRIPT = """
(function () {{
  var root = document.getElementById("{name}"), frames = root.querySelectorAll("[data-frame]");
  var bar = root.querySelector("input"), play = root.querySelector("button"), timer = null;
  function show() {{
    frames.forEach(function (frame, i) {{ frame.hidden = i !== Number(bar.value); }});
  }}
  function stop() {{ clearInterval(timer); timer = null; play.textContent = "Play"; }}
  function step() {{
    if (Number(bar.value) >= frames.length - 1) {{ stop(); return; }}
    bar.value = Number(bar.value) + 1; show();
  }}
  bar.addEventListener("input", function () {{ stop(); show(); }});
  play.addEventListener("click", function () {{
    if (timer) {{ stop(); return; }}
    if (Number(bar.value) >= frames.length - 1) {{ bar.value = 0; show(); }}
    play.textContent = "Pause"; timer = setInterval(step, 500);
  }});
  root.querySelector("[data-controls]").hidden = false;
}})();
"""


def animate(name: str, frames: Sequence[str], captions: Sequence[str]) -> str:
    """HTML that shows one frame at a time, chosen with a slider or played in order.

    The first frame is shown; without JavaScript, a line of text says that there are more.  A frame
    is HTML as wide as its place, its caption the plain text of the line below it, and ``name`` the
    id of the HTML element, unique on its page.
    """
    last = len(frames) - 1
    shown = "\n".join(
        f'<div data-frame="{i}"{" hidden" if i else ""}>{frame}'
        f'<div style="text-align:center;min-height:3em">{escape(caption)}</div></div>'
        for i, (frame, caption) in enumerate(zip(frames, captions, strict=True))
    )
    return f"""<div id="{name}" style="background:#fff;color:#111;max-width:520px;margin:auto">
{shown}
<div data-controls hidden>
<div style="display:flex;gap:0.6em;align-items:center;padding:0.3em 0.6em">
<button type="button" style="min-width:4.5em">Play</button>
<input type="range" min="0" max="{last}" value="0" step="1" style="flex:1"
 aria-label="Step of the animation">
</div></div>
<noscript>The slider needs JavaScript: this is the first step.</noscript>
<script>{_SCRIPT.format(name=name)}</script>
</div>"""
