"""Write the log of ``python -m d2d.radar example`` as a script that the laboratory of logs loads.

A book that is opened from a folder can load scripts, but no CSV file.  A target takes a few digits,
because the simulated radar rounds what it measures.  Run it from the root of the project after a
change of the simulation.
"""

import json
from pathlib import Path

import numpy as np

from d2d.radar import simulate_drive

SCRIPT = Path("_static/labs/example.js")
STEPS = {"range": 1 / 16, "azimuth": 1e-4, "doppler": 1 / 16}  # m, rad, m/s
TEXT = """\
// The log of `python -m d2d.radar example`, written by tools/example_log.py: a scan of 0.1 s in
// each line, a target as range, azimuth and Doppler velocity in the radar's steps, and the number
// of its three standard deviations.
globalThis.exampleLog = (() => {{
  const columns = ["range", "azimuth", "doppler", "sigma_range", "sigma_azimuth", "sigma_doppler"],
    steps = {steps},
    sigmas = {sigmas};
  const rows = `
{scans}
`
    .trim()
    .split("\\n")
    .flatMap((scan, i) =>
      scan.split(" ").map((target) => {{
        const [sigma, ...measured] = target.split(",").reverse();
        const values = measured.reverse().map((each, column) => each * steps[column]);
        return [i / 10, "radar", ...values, ...sigmas[sigma]].join();
      }}),
    );
  return [["time", "sensor", ...columns].join(), ...rows].join("\\n");
}})();
"""


def main() -> None:
    scans = simulate_drive(np.random.default_rng(0), duration=60.0).scans
    sigmas: list[list[float]] = []
    lines = []
    for i, scan in enumerate(scans):
        assert scan.time == i / 10
        columns = [np.round(getattr(scan, name) / step) for name, step in STEPS.items()]
        for (name, step), column in zip(STEPS.items(), columns, strict=True):
            assert (column * step == getattr(scan, name)).all()
        triples = np.column_stack([scan.sigma_range, scan.sigma_azimuth, scan.sigma_doppler])
        sigmas += [own for own in np.unique(triples, axis=0).tolist() if own not in sigmas]
        numbers = [sigmas.index(own) for own in triples.tolist()]
        rows = zip(*(column.astype(int).tolist() for column in columns), numbers, strict=True)
        lines.append(" ".join(",".join(map(str, row)) for row in rows))
    steps = json.dumps([*STEPS.values()])
    text = TEXT.format(steps=steps, sigmas=json.dumps(sigmas), scans="\n".join(lines))
    SCRIPT.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
