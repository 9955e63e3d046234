"""Install d2d and its peers, one by one, into the environment that runs this script.

A peer that cannot be installed does not stop the others: the reason is stored in ``peers.json`` in
the environment, and the benchmark reports it.
"""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def pip(*arguments: str) -> str:
    """Run ``pip install``; return its error, or an empty string."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    done = subprocess.run([*command, *arguments], capture_output=True, text=True)
    return "" if done.returncode == 0 else reason(done.stderr)


def reason(output: str) -> str:
    """The first error line of pip's output."""
    errors = [line for line in output.splitlines() if re.match(r"\s*(error|ERROR)", line)]
    return (errors or output.splitlines() or ["pip failed"])[0].strip()


def main() -> None:
    """Install d2d with the versions of requirements.txt, then each peer of the extra `bench`."""
    pins = [line for line in (ROOT / "requirements.txt").read_text().splitlines() if "==" in line]
    constraints = Path(sys.prefix) / "constraints.txt"
    constraints.write_text("\n".join(pins) + "\n")
    failed = pip("--constraint", str(constraints), "--editable", str(ROOT))
    if failed:
        sys.exit(f"d2d could not be installed: {failed}")
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    reasons = {}
    for peer in extras["optional-dependencies"]["bench"]:
        name = peer.split("==")[0]
        reasons[name] = pip("--constraint", str(constraints), peer)
        print(f"{peer}: {reasons[name] or 'installed'}", flush=True)
    (Path(sys.prefix) / "peers.json").write_text(json.dumps(reasons, indent=1) + "\n")


if __name__ == "__main__":
    main()
