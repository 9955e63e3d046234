"""How an estimate and its reference are drawn in every picture of a track, and in the book."""

from typing import Any

COLOR, MARKER = "#009E73", "o"  # Okabe and Ito's bluish green, which colour-blind readers tell
LINE = (0, (6.0, 1.2, 1.2, 1.2))  # dash-dotted
ESTIMATE: dict[str, Any] = {"color": COLOR, "ls": LINE}
REFERENCE: dict[str, Any] = {"color": "#000000", "ls": "--", "lw": 0.9}
