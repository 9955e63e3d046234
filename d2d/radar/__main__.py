"""`python -m d2d.radar`: from a recording to a path, without writing Python."""

from d2d.radar.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
